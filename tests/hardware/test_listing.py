"""Serial ports of a machine that is built from files."""

import json
from argparse import Namespace
from pathlib import Path

import pytest

from gateway.cli.verbs import ports as verb
from gateway.hardware import device_files, holders, listing
from gateway.hardware.listing import ListedPort, list_serial_ports


class Adapter:
    manufacturer = "FTDI"
    product = "USB-RS485 Cable"


class BuiltIn:
    manufacturer = product = None


class Machine:
    """Its /dev, /sys/class/tty and /proc, as folders."""

    def __init__(self, root):
        self.devices = root / "dev"
        self.terminals = root / "tty"
        self.hardware = root / "hardware"
        self.processes = root / "proc"
        for folder in (self.devices, self.terminals, self.processes):
            folder.mkdir()

    def terminal(self, name, driver=None, **attributes):
        """A terminal, with hardware when it has a driver."""
        (self.devices / name).touch()
        (self.terminals / name).mkdir()
        for attribute, value in attributes.items():
            (self.terminals / name / attribute).write_text(f"{value}\n")
        if driver:
            place = self.hardware / name
            place.mkdir(parents=True)
            (self.hardware / driver).mkdir(exist_ok=True)
            (place / "driver").symlink_to(self.hardware / driver)
            (self.terminals / name / "device").symlink_to(place)

    def link(self, link, name):
        path = self.devices / "serial" / link
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(self.devices / name)
        return str(path)

    def process(self, pid, name, opened):
        descriptors = self.processes / str(pid) / "fd"
        descriptors.mkdir(parents=True)
        (self.processes / str(pid) / "comm").write_text(f"{name}\n")
        (descriptors / "3").symlink_to(self.devices / opened)


@pytest.fixture
def machine(tmp_path, monkeypatch):
    machine = Machine(tmp_path)
    monkeypatch.setattr(listing, "TERMINALS", machine.terminals)
    monkeypatch.setattr(listing, "DEVICES", machine.devices)
    monkeypatch.setattr(holders, "PROC", machine.processes)
    monkeypatch.setattr(listing, "SysFS", lambda device: Adapter if "USB" in device else BuiltIn)
    return machine


def test_ports_come_in_the_order_of_their_numbers(machine):
    for name in ("ttyUSB10", "ttyUSB2", "ttyS1"):
        machine.terminal(name, driver="some")
    assert [Path(port.device).name for port in list_serial_ports()] == ["ttyS1", "ttyUSB2", "ttyUSB10"]


def test_what_has_no_hardware_is_left_out(machine):
    machine.terminal("tty1")
    machine.terminal("ttyS0", driver="serial8250", type=4)
    machine.terminal("ttyS1", driver="serial8250", type=0)
    assert [Path(port.device).name for port in list_serial_ports()] == ["ttyS0"]


def test_the_link_by_serial_number_is_the_best(machine):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    machine.link("by-path/pci-0-usb-0:1", "ttyUSB0")
    best = machine.link("by-id/usb-FTDI_A1-if00-port0", "ttyUSB0")
    device = str(machine.devices / "ttyUSB0")
    assert list_serial_ports() == [ListedPort(best, device, "FTDI USB-RS485 Cable", "ftdi_sio", "free", "")]


def test_the_link_by_socket_is_the_second_best(machine):
    machine.terminal("ttyUSB0", driver="ch341")
    link = machine.link("by-path/pci-0-usb-0:1", "ttyUSB0")
    assert list_serial_ports()[0].path == link


def test_a_built_in_port_keeps_its_name(machine):
    machine.terminal("ttyS0", driver="serial8250", type=4)
    (port,) = list_serial_ports()
    assert (port.path, port.description) == (port.device, "built in")


def test_a_port_that_a_program_has_open_is_in_use(machine):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    machine.process(412, "mbusd", "ttyUSB0")
    (port,) = list_serial_ports()
    assert (port.state, port.remark) == ("in use", "by mbusd (pid 412)")


def test_a_lock_betrays_a_program_of_another_user(machine):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    node = (machine.devices / "ttyUSB0").stat()
    device = f"{node.st_dev >> 8 & 0xFFF:02x}:{node.st_dev & 0xFF:02x}:{node.st_ino}"
    (machine.processes / "locks").write_text(
        f"1: POSIX  ADVISORY  WRITE 9 00:01:1 0 EOF\n2: FLOCK  ADVISORY  WRITE 77 {device} 0 EOF\n"
    )
    assert list_serial_ports()[0].remark == "by a program (pid 77)"


def test_a_port_without_permission_says_what_to_do(machine, monkeypatch):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    monkeypatch.setattr(listing.os, "access", lambda path, mode: False)
    monkeypatch.setattr(device_files, "find_group", lambda path: "dialout")
    (port,) = list_serial_ports()
    assert (port.state, port.remark) == ("no permission", "add the user to the dialout group")


def test_nobody_is_advised_to_join_the_group_root(machine, monkeypatch):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    monkeypatch.setattr(listing.os, "access", lambda path, mode: False)
    monkeypatch.setattr(device_files, "find_group", lambda path: "root")
    (port,) = list_serial_ports()
    assert "to the root group" not in port.remark
    assert 'give it to the group dialout: echo \'KERNEL=="ttyUSB0", GROUP="dialout"' in port.remark


# --- the verb ---


def test_the_verb_prints_a_table_and_the_line_for_the_config(machine, capsys):
    machine.terminal("ttyUSB0", driver="ftdi_sio")
    machine.process(412, "mbusd", "ttyUSB0")
    link = machine.link("by-id/usb-FTDI_A1-if00-port0", "ttyUSB0")
    assert verb.run(Namespace(json=False)) == 0
    heading, row, _, hint = capsys.readouterr().out.splitlines()
    assert heading.split() == ["PORT", "DEVICE", "ADAPTER", "DRIVER", "STATE"]
    assert row.startswith(link)
    assert row.endswith("FTDI USB-RS485 Cable  ftdi_sio  in use by mbusd (pid 412)")
    assert hint.endswith(f'port = "{link}"')


def test_the_verb_prints_json(machine, capsys):
    machine.terminal("ttyS0", driver="serial8250", type=4)
    assert verb.run(Namespace(json=True)) == 0
    (port,) = json.loads(capsys.readouterr().out)
    assert port == {
        "path": str(machine.devices / "ttyS0"),
        "device": str(machine.devices / "ttyS0"),
        "description": "built in",
        "driver": "serial8250",
        "state": "free",
        "remark": "",
    }


def test_the_verb_says_so_when_there_is_no_port(machine, capsys):
    assert verb.run(Namespace(json=False)) == 0
    assert capsys.readouterr().out.startswith("No serial port found.")
    assert verb.run(Namespace(json=True)) == 0
    assert capsys.readouterr().out == "[]\n"
