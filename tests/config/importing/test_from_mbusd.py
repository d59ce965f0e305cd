"""Configs of mbusd become one of ours, which passes its checks and does the same."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.importing.from_mbusd import config_from_mbusd
from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.routing.access import READING, WRITING

#: A file as its manual describes it, for a UART with RS-485.
SAMPLE = """
########## Serial port ##########
device = /dev/ttyS1
speed=9600
  mode = 8e1
trx_control = rts
address = 10.0.0.1
port = 1502
maxconn = 8
timeout = 0
retries = 2
pause = 50
wait = 1500
loglevel = 2
"""


def imported(**files: str) -> Imported:
    """What is made of these files; `a` stands for a.conf."""
    texts = {f"{name}.conf": text for name, text in files.items()}
    return config_from_mbusd([*texts], texts.__getitem__)


def plan_of(text: str):
    loaded = parse(text, port_trouble=lambda _: None)
    assert loaded.config is not None, "\n".join(map(str, loaded.problems))
    return resolve(loaded.config)


def test_each_key_means_the_same():
    plan = plan_of(imported(a=SAMPLE).text)
    (listener,), (line,) = plan.listeners, plan.lines
    assert (listener.host, listener.port, listener.clients, listener.idle) == ("10.0.0.1", 1502, 8, 0.0)
    assert (listener.line, listener.unit0) == ("ttyS1", "broadcast")
    assert (line.port.port, line.port.baud, str(line.port.format), line.port.rs485) == (
        "/dev/ttyS1",
        9600,
        "8E1",
        "kernel",
    )
    assert (line.line.gap, line.line.retries) == (0.05, 2)
    assert {device.answer_time.timeout for device in line.devices} == {1.5}
    assert len(line.devices) == 247


def test_what_is_left_out_has_the_default_of_mbusd():
    (listener,), (line,) = (plan := plan_of(imported(a="").text)).listeners, plan.lines
    assert (listener.host, listener.port, listener.clients, listener.idle) == ("0.0.0.0", 502, 32, 60.0)
    assert (line.port.port, line.port.baud, str(line.port.format)) == ("/dev/ttyS0", 19200, "8N1")
    assert (line.line.gap, line.line.retries, line.port.rs485) == (0.1, 3, "adapter")


def test_every_client_may_write_as_before():
    plan = plan_of(imported(a="").text)
    (row,) = plan.access
    assert row.networks is row.listeners is row.units is None
    assert row.right == READING | WRITING


def test_a_file_for_each_port_becomes_a_line_for_each():
    other = "device = /dev/serial/by-path/ttyS1\nport = 503\n"
    text, left_out, _ = imported(a=SAMPLE, b=other)
    assert left_out == ()
    assert [one.line for one in plan_of(text).listeners] == ["ttyS1", "ttyS1-2"]
    assert [one.line.name for one in plan_of(text).lines] == ["ttyS1", "ttyS1-2"]


@pytest.mark.parametrize(
    ("second", "why"),
    [
        ("device = /dev/ttyS1\nport = 503\n", "b.conf: /dev/ttyS1 is the port of a.conf too"),
        ("device = /dev/ttyS2\nport = 1502\n", "b.conf: another listener has tcp://0.0.0.0:1502 already"),
        ("device = /dev/ttyS2\nspeed = fast\n", "b.conf:2: speed must be a number from 1 to 100000000"),
    ],
)
def test_a_file_that_cannot_be_used_is_left_out_and_said(second, why):
    text, left_out, _ = imported(a=SAMPLE, b=second, c="device = /dev/ttyS3\nport = 505\n")
    assert left_out == (why,)
    assert f"\n# Left out: {why}\n" in text
    assert [line.port.port for line in plan_of(text).lines] == ["/dev/ttyS1", "/dev/ttyS3"]


def test_a_file_that_cannot_be_used_takes_nothing_from_others():
    text, left_out, _ = imported(a="device = /dev/ttyS1\nport = 503\nmode = 7e1", b="device = /dev/ttyS1\nport = 503\n")
    assert left_out == ("a.conf:3: mode must be one such as 8N1",)
    assert [line.port.port for line in plan_of(text).lines] == ["/dev/ttyS1"]


def test_without_a_usable_file_there_is_no_config():
    with pytest.raises(ImportedFileError) as error:
        imported(a="speed = 0", b="a line")
    assert str(error.value).splitlines() == [
        "a.conf:1: speed must be a number from 1 to 100000000",
        "b.conf:1: this is not a line of an mbusd config: it has no =",
    ]


USB = ["/dev/ttyUSB0", "/dev/ttyACM1", "/dev/serial/by-id/usb-FTDI_X-if00-port0", "/dev/serial/by-path/pci-0-usb-0:1"]


@pytest.mark.parametrize(
    ("setting", "device", "rs485"),
    [
        ("", "/dev/ttyS1", "adapter"),
        ("enable_rs485 = yes", "/dev/ttyS1", "kernel"),
        ("enable_rs485 = no", "/dev/ttyS1", "adapter"),
        ("trx_control = rts_1", "/dev/ttyAMA0", "kernel"),
        ("trx_control = addc", "/dev/ttyS1", "adapter"),
        ("trx_control = sysfs_1", "/dev/ttyS1", "adapter"),
        *((setting, device, "adapter") for setting in ("enable_rs485 = yes", "trx_control = rts") for device in USB),
    ],
)
def test_the_kernel_switches_the_direction_where_mbusd_did_and_a_driver_can(setting, device, rs485):
    text, _, _ = imported(a=f"device = {device}\n{setting}\n")
    (line,) = plan_of(text).lines
    assert line.port.rs485 == rs485
    assert ("# mbusd switched the direction of this USB adapter" in text) == (bool(setting) and device in USB)


def test_an_echo_is_stripped():
    assert [plan_of(imported(a=f"local_echo = {value}").text).lines[0].line.echo for value in ("yes", "no")] == [
        True,
        False,
    ]


def test_comments_behind_values_are_none_of_them():
    text, _, _ = imported(a="speed = 9600 # slow\ndevice = /dev/ttyS2\t#2\nport=503 #\ntrx_sysfile = # none\n#a # b\n")
    (listener,), (line,) = (plan := plan_of(text)).listeners, plan.lines
    assert (listener.port, line.port.port, line.port.baud) == (503, "/dev/ttyS2", 9600)
    assert "which is not known here" not in text


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("trx_control = sysfs_0", "# mbusd switched the direction with a GPIO in sysfs"),
        ("trx_control = rts_0", "# RTS was low while sending"),
        ("replyonbroadcast = yes", "# mbusd answered broadcasts; the gateway does not"),
        ("retries = 1", "# mbusd repeated writes too"),
        ("colour = blue", "# mbusd had colour = blue, which is not known here"),
    ],
)
def test_what_is_not_the_same_is_said(setting, said):
    assert f"\n{said}" in imported(a=setting).text


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("speed = fast", "a.conf:1: speed must be a number from 1 to 100000000"),
        ("mode = 7e1", "a.conf:1: mode must be one such as 8N1"),
        ("\nmaxconn = 0", "a.conf:2: maxconn must be a number from 1 to 128"),
        ("device = ttyS0", 'a.conf:1: "ttyS0" is not an absolute path'),
        ("address = here!", "a.conf:1: 'here!' is not a valid host name"),
        ("a line", "a.conf:1: this is not a line of an mbusd config: it has no ="),
    ],
)
def test_what_cannot_be_understood_names_its_line(setting, said):
    with pytest.raises(ImportedFileError) as error:
        imported(a=setting)
    assert str(error.value) == said


VALUES = {
    "device": st.sampled_from(["/dev/ttyS0", "/dev/ttyUSB1", "/dev/control", "/dev/a b", '/dev/"x"', "/dev/é", "x"]),
    "speed": st.integers(0, 200_000).map(str),
    "mode": st.sampled_from(["8N1", "8e1", "8o2", "7E1", "8n"]),
    "trx_control": st.sampled_from(["addc", "rts", "rts_0", "sysfs_1", "?"]),
    "address": st.sampled_from(["0.0.0.0", "::", "[::1]", "localhost", "plc.example", "10.0.0.1", "*", "", "1.2.3"]),
    "port": st.integers(0, 70_000).map(str) | st.just("502"),
    "maxconn": st.integers(0, 200).map(str),
    "timeout": st.integers(0, 2000).map(str),
    "retries": st.integers(0, 20).map(str),
    "pause": st.integers(0, 20_000).map(str),
    "wait": st.integers(0, 20_000).map(str),
    "replyonbroadcast": st.sampled_from(["yes", "no", ""]),
    "enable_rs485": st.sampled_from(["yes", "no"]),
    "local_echo": st.sampled_from(["yes", "no", "yes # echoes"]),
    "loglevel": st.just("9"),
    "other": st.text(max_size=9),
}


@st.composite
def files(draw) -> str:
    keys = draw(st.lists(st.sampled_from(sorted(VALUES)), unique=True, max_size=8))
    return "\n".join(f"{key} = {draw(VALUES[key])}" for key in keys)


@given(st.lists(files(), min_size=1, max_size=4))
def test_whatever_it_prints_passes_check(texts):
    with suppress(ImportedFileError):
        plan_of(imported(**{f"n{number}": text for number, text in enumerate(texts)}).text)
