"""Ports that cannot be used as they are, or should not."""

from dataclasses import replace

import pytest

from gateway.diagnosis.evidence import Holder, PortEvidence
from gateway.diagnosis.ports import about_ports

BY_ID = "/dev/serial/by-id/usb-FTDI_A1-if00-port0"
PORT = PortEvidence(
    "hall",
    "gateway.toml:3",
    BY_ID,
    device="ttyUSB0",
    is_usb=True,
    stable_path=BY_ID,
    user="modbus-gateway",
    group="dialout",
    is_ours=True,
)


def rows(port):
    return [(each.level, each.what, each.remedy) for each in about_ports(port)]


def test_a_healthy_port_has_one_row():
    assert rows(PORT) == [("ok", f"{BY_ID}: no other program has it open, and modbus-gateway may open it", "")]


def test_a_port_that_does_not_exist_is_named():
    ((level, what, _),) = rows(replace(PORT, exists=False))
    assert (level, what) == ("fix", f"{BY_ID} does not exist")


def test_a_user_who_may_not_open_it_is_named_with_the_group():
    ((level, what, remedy),) = rows(replace(PORT, may_open=False, is_ours=False))
    assert (level, what) == ("fix", f"modbus-gateway may not open {BY_ID}; the group dialout may")
    assert remedy.startswith("usermod -a -G dialout modbus-gateway")


def test_a_port_of_root_alone_is_given_to_dialout_and_no_terminal_with_it():
    ((_, _, remedy),) = rows(replace(PORT, group="root", may_open=False, is_ours=False))
    assert remedy.startswith("""echo 'KERNEL=="ttyUSB0", GROUP="dialout", MODE="0660"' | sudo tee -a /etc/udev/""")


@pytest.mark.parametrize(
    ("holder", "remedy"),
    [
        (Holder("ModemManager", 412), "systemctl disable --now ModemManager"),
        (Holder("brltty", 412), "systemctl disable --now brltty-udev.service brltty.service"),
        (Holder("mbusd", 412), "end it: kill 412"),
        (Holder("python poll.py", 412, is_interpreter=True), "ps -fp 412 shows what it is; end it if nothing needs it"),
    ],
)
def test_a_program_that_has_taken_the_adapter_is_named(holder, remedy):
    assert rows(replace(PORT, holders=(holder,))) == [("fix", f"{holder.name} (pid 412) has {BY_ID} open, too", remedy)]


def test_another_gateway_is_not_to_be_killed():
    other = replace(PORT, holders=(Holder("modbus-gateway", 412),))
    ((level, what, remedy),) = rows(other)
    assert (level, what) == ("fix", f"modbus-gateway (pid 412) has {BY_ID} open, too")
    assert remedy == "give one of the two another port, or stop the other: systemctl stop modbus-gateway, or Ctrl-C"
    assert rows(replace(other, is_standby=True)) == []
    assert len(rows(replace(PORT, holders=(Holder("brltty", 412),), is_standby=True))) == 1


def test_a_program_that_may_take_it_is_a_note():
    assert [row[0] for row in rows(replace(PORT, probers=("ModemManager",)))] == ["note", "ok"]
    assert [row[0] for row in rows(replace(PORT, probers=("ModemManager",), is_usb=False))] == ["ok"]


def test_a_latency_timer_of_16_ms_needs_fixing_while_the_gateway_has_the_port():
    ((level, what, remedy),) = rows(replace(PORT, device="ttyUSB3", latency_timer=0.016))
    assert (level, what) == (
        "fix",
        "the adapter holds received bytes back for 16 ms (latency timer), which is added to each response time",
    )
    assert remedy.startswith("echo 1 > /sys/class/tty/ttyUSB3/device/latency_timer")
    assert [row[0] for row in rows(replace(PORT, latency_timer=0.016, is_ours=False))] == ["note", "ok"]
    assert [row[0] for row in rows(replace(PORT, latency_timer=0.001))] == ["ok"]


def test_a_path_that_changes_is_a_note_with_the_one_that_stays():
    (note, ok) = rows(replace(PORT, port="/dev/ttyUSB0"))
    assert note[::2] == ("note", f'gateway.toml:3: port = "{BY_ID}"')
    assert ok[0] == "ok"
