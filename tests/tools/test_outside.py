"""Ports of a machine that is built from files: what can be seen of them without opening them."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.diagnosis.evidence import Holder, PortInUse
from gateway.diagnosis.ports import about_ports
from gateway.hardware.holders import find_holders
from gateway.tools.outside import Places, look_at

GATEWAY = 4711


class Machine:
    """Its /dev, /sys/class/tty and /proc, as folders, with an FTDI adapter and a gateway."""

    def __init__(self, root) -> None:
        self.places = Places(root / "dev", root / "tty", root / "proc")
        for folder in (self.places.devices / "serial/by-id", root / "tty/ttyUSB0", self.places.programs, root / "usb"):
            folder.mkdir(parents=True)
        self.device = self.places.devices / "ttyUSB0"
        self.device.touch()
        adapter = root / "adapter"
        adapter.mkdir()
        (adapter / "subsystem").symlink_to(root / "usb")
        (self.places.terminals / "ttyUSB0/device").symlink_to(adapter)
        self.link = self.places.devices / "serial/by-id/usb-FTDI_A1-if00-port0"
        self.link.symlink_to(self.device)
        self.timer = adapter / "latency_timer"
        self.process(GATEWAY, "modbus-gateway", self.device)

    def process(self, pid, name, *opened, uid=None, groups=(), arguments=()) -> None:
        folder = self.places.programs / str(pid)
        (folder / "fd").mkdir(parents=True)
        (folder / "comm").write_text(f"{name}\n")
        (folder / "cmdline").write_text("".join(f"{argument}\0" for argument in arguments))
        ids = [os.geteuid() if uid is None else uid] * 4
        gids = [os.getegid() if uid is None else 65534] * 4
        rows = {"Uid": ids, "Gid": gids, "Groups": groups}
        (folder / "status").write_text("".join(f"{key}:\t{' '.join(map(str, row))}\n" for key, row in rows.items()))
        for number, path in enumerate(opened):
            (folder / "fd" / str(number)).symlink_to(path)

    def look(self, *, port=None, pid=GATEWAY, is_open=True):
        return look_at(PortInUse("hall", "gateway.toml:3", str(port or self.link), is_open), pid, self.places)


def test_that_another_gateway_may_have_the_port_is_kept(machine) -> None:
    port = PortInUse("hall", "gateway.toml:3", str(machine.link), is_open=False, is_standby=True)
    assert look_at(port, GATEWAY, machine.places).is_standby
    assert not machine.look().is_standby


@pytest.fixture
def machine(tmp_path) -> Machine:
    return Machine(tmp_path)


def levels(evidence) -> list[str]:
    return [each.level for each in about_ports(evidence)]


def test_a_healthy_port_is_ok(machine) -> None:
    evidence = machine.look()
    assert evidence.exists
    assert evidence.is_usb
    assert evidence.may_open
    assert evidence.is_ours
    assert evidence.holders == ()
    assert levels(evidence) == ["ok"]


def test_a_port_that_is_not_there(machine) -> None:
    assert levels(machine.look(port="/dev/ttyUSB77")) == ["fix"]


def test_an_adapter_that_another_program_has_taken(machine) -> None:
    machine.process(412, "ModemManager", machine.device)
    evidence = machine.look()
    assert evidence.holders == (Holder("ModemManager", 412),)
    assert [(each.level, each.remedy) for each in about_ports(evidence)] == [
        ("fix", "systemctl disable --now ModemManager")
    ]


@pytest.mark.parametrize(
    ("comm", "arguments", "name"),
    [
        ("python", "python -P -m gateway.cli.main run -c gateway.toml", "modbus-gateway"),
        ("python3", "/usr/bin/python3 /usr/bin/modbus-gateway run", "modbus-gateway"),
        ("python3.12", "python3.12 -W ignore poll.py --password secret", "python3.12 poll.py"),
        ("python", "python -m serial.tools.miniterm /dev/ttyUSB0", "python -m serial.tools.miniterm"),
        ("sh", "sh -c secret", "sh -c"),
        ("bash", "", "bash"),
        ("mbusd", "mbusd gateway.cli.main", "mbusd"),
    ],
)
def test_an_interpreter_is_named_with_what_it_runs(machine, comm, arguments, name) -> None:
    machine.process(412, comm, machine.device, arguments=arguments.split())
    (holder,) = machine.look().holders
    assert (holder.name, holder.is_interpreter) == (name, name not in {"modbus-gateway", "mbusd"})


def test_a_standby_in_a_checkout_takes_the_holder_of_its_lease_for_a_gateway(machine) -> None:
    machine.process(412, "python", machine.device, arguments=["python", "-m", "gateway.cli.main"])
    evidence = machine.look(is_open=False)
    assert [each.level for each in about_ports(replace(evidence, is_standby=True))] == []
    assert not any("kill" in each.remedy for each in about_ports(evidence))


@pytest.mark.parametrize(("major", "is_held"), [(136, False), (188, True)])
def test_a_container_has_terminals_of_its_own_but_the_same_adapters(machine, monkeypatch, major, is_held) -> None:
    machine.process(412, "ser2net", machine.device)
    found = {machine.device: 6, machine.places.programs / "412/fd/0": 7}  # the file systems of /dev, and what they have
    real = Path.stat

    def stat(path: Path, **how: bool) -> os.stat_result | SimpleNamespace:
        if path in found:
            return SimpleNamespace(st_dev=found[path], st_rdev=os.makedev(major, 3), st_ino=1)
        return real(path, **how)

    monkeypatch.setattr(Path, "stat", stat)
    assert find_holders(machine.device, machine.places.programs) == ({412} if is_held else set())


def test_a_program_that_only_runs_is_a_note(machine) -> None:
    machine.process(412, "ModemManager")
    assert machine.look().probers == ("ModemManager",)
    assert levels(machine.look()) == ["note", "ok"]


def test_the_gateway_is_no_other_program_but_an_unknown_one_is(machine) -> None:
    assert machine.look(pid=None).holders == (Holder("modbus-gateway", GATEWAY),)


def test_the_latency_timer_of_an_ftdi_adapter(machine) -> None:
    assert machine.look().latency_timer is None
    machine.timer.write_text("16\n")
    assert machine.look().latency_timer == 0.016
    assert levels(machine.look()) == ["fix"]
    machine.timer.write_text("1\n")
    assert levels(machine.look()) == ["ok"]


def test_the_path_that_stays(machine) -> None:
    assert machine.look(port=machine.device).stable_path == str(machine.link)


def test_the_right_of_the_user_of_the_gateway(machine) -> None:
    machine.device.chmod(0o660)
    machine.process(5, "modbus-gateway", uid=65533)
    evidence = machine.look(pid=5, is_open=False)
    assert not evidence.may_open
    assert levels(replace(evidence, holders=())) == ["fix"]
    machine.process(6, "modbus-gateway", uid=65533, groups=[os.getegid()])
    assert machine.look(pid=6).may_open
    machine.device.chmod(0o666)
    assert machine.look(pid=5).may_open
