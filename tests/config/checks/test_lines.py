"""The keys of a line."""

import pytest

from kit.config_problems import LINE, problems


def test_a_device_server_whose_scheme_is_another_mode():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nmode = "ascii"')
    assert problems(text) == [
        ('error: line[0].mode: rtu+tcp:// carries RTU | leave mode out, or write port = "ascii+tcp://10.0.0.1:4001"')
    ]
    assert problems(text.replace('"ascii"', '"rtu"')) == []


def test_a_device_server_with_seven_bits():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nformat = "7E1"')
    assert problems(text) == ['error: line[0].format: RTU needs 8 data bits | write "8E1", or ascii+tcp:// in port']
    assert problems(text.replace("rtu+", "ascii+")) == []


def test_a_device_server_has_no_kernel_driver_here():
    text = LINE.replace('"/dev/a"', '"rtu+tcp://10.0.0.1:4001"\nrs485 = "kernel"')
    assert problems(text) == [
        (
            "error: line[0].rs485: a device server controls its own driver"
            ' | set RS-485 in the device server, and leave rs485 out or "adapter"'
        )
    ]


@pytest.mark.parametrize(
    ("mode", "character_format", "said"),
    [
        ("rtu", "7E1", ['error: line[0].format: RTU needs 8 data bits | write "8E1", or mode = "ascii"']),
        ("rtu", "8N2", []),
        (
            "ascii",
            "8E1",
            ['warning: line[0].format: 8E1 is unusual for ASCII devices | most are set to "7E1", "7O1" or "8N1"'],
        ),
        ("ascii", "8N1", []),
        ("ascii", "7O1", []),
    ],
)
def test_the_format_fits_the_mode(mode, character_format, said):
    assert problems(LINE + f'mode = "{mode}"\nformat = "{character_format}"\n') == said


def test_a_client_line_has_no_keys_of_a_server_line():
    assert problems(LINE + 'serves = 1\nanswer_within = "1 s"\n') == [
        'error: line[0].serves: only a line with role = "server" has this key',
        'error: line[0].answer_within: only a line with role = "server" has this key',
    ]


SERVER = '[[line]]\nname = "panel"\nport = "/dev/p"\nrole = "server"\n'


def test_a_server_line_has_no_keys_of_a_client_line():
    text = LINE + SERVER + "serves = 1\nretries = 1\ndevices = [{ unit = 5 }]\n"
    assert problems(text) == [
        'error: line[1].retries: only a line with role = "client" has this key',
        'error: line[1].devices: only a line with role = "client" has this key',
    ]


def test_a_server_line_serves_something():
    assert problems(LINE + SERVER) == [
        (
            "error: line[1].serves: serves is missing"
            ' | name the units that the gateway answers for: serves = [41]; or serves = "all"'
        )
    ]


@pytest.mark.parametrize(("scheme", "frames"), [("rtu+tcp", "RTU"), ("ascii+tcp", "ASCII")])
def test_a_device_server_at_the_port_of_modbus_tcp_is_noted(scheme, frames):
    line = f'[[line]]\nport = "{scheme}://10.1.0.9:502"\n'
    assert problems(line) == [
        (
            f"warning: line[0].port: port 502 is that of Modbus TCP, and {scheme}:// sends bare {frames} frames"
            ' | if the server speaks Modbus TCP: [[upstream]] with to = "tcp://10.1.0.9:502"'
        )
    ]
    assert problems(line.replace("502", "4001")) == []


@pytest.mark.parametrize("key", ["idle", "after_connect"])
def test_only_a_device_server_has_a_connection(key):
    line = f'[[line]]\nport = "{{}}"\nprofile = "generic"\n{key} = "2 s"\n'
    assert problems(line.format("rtu+tcp://10.1.0.5:4001")) == []
    assert problems(line.format("/dev/a")) == [
        f"error: line[0].{key}: is for lines behind a device server | take it out"
    ]


def test_a_line_with_a_lease_is_not_left_when_nobody_asks():
    line = '[[line]]\nport = "rtu+tcp://10.1.0.5:4001"\nlease = "hall"\nidle = "2 s"\n'
    assert [each for each in problems(line) if ".idle" in each] == [
        (
            "error: line[0].idle: a line with a lease keeps its connection"
            " | take idle out: who holds a lease has to hear whether another gateway asks"
        )
    ]


VIRTUAL = '[[line]]\nport = "pty:ttyHMI"\nrole = "server"\nserves = "all"\n'


def test_a_virtual_port():
    assert problems(LINE + VIRTUAL + 'group = "users"\nbaud = 300\nmode = "ascii"\nformat = "8N1"\n') == []


def test_a_virtual_port_has_no_devices():
    told = (
        "error: line[0].port: a virtual port has programs at its other end, and no devices"
        ' | role = "server", if programs of this machine ask there; to ask devices, name the port of an adapter'
    )
    assert problems('[[line]]\nport = "pty:ttyHMI"\ndevices = [{ unit = 1 }]\n') == [told]


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ('rs485 = "kernel"', "error: line[1].rs485: a virtual port has no driver to control | leave rs485 out"),
        ("echo = true", "error: line[1].echo: a virtual port echoes nothing | leave echo out"),
        (
            'format = "8E1"',
            "warning: line[1].format: a virtual port carries 8N1 only | set the programs to 8N1, and leave format out",
        ),
    ],
)
def test_what_a_virtual_port_does_not_have(key, told):
    assert problems(LINE + VIRTUAL + key + "\n") == [told]


def test_delays_are_for_the_driver_that_switches_the_transmitter():
    told = (
        'error: line[0].rs485_delay: has no meaning: it is for rs485 = "kernel"'
        ' | take it out, or write rs485 = "kernel" if the driver switches the transmitter'
    )
    assert problems(LINE + 'rs485_delay = ["1 ms", "0"]\n') == [told]
    assert problems(LINE + 'rs485 = "kernel"\nrs485_delay = ["1 ms", "0"]\n') == []


def test_the_group_of_an_adapter_is_not_set_here():
    told = "error: line[0].group: is for virtual ports | take it out: the port of an adapter has its group from udev"
    assert problems(LINE + 'group = "users"\n') == [told]


@pytest.mark.parametrize("name", ["", "a/b", "..", ".hidden", "control.sock", "/", "/run/x/", "tty HMI"])
def test_a_link_needs_a_name(name):
    told = f'error: line[1].port: "{name}" is neither a name nor an absolute path | write a name such as "pty:ttyHMI"'
    assert problems(LINE + VIRTUAL.replace("ttyHMI", name)) == [told]


def test_two_lines_with_the_same_virtual_port():
    other = VIRTUAL.replace("[[line]]", '[[line]]\nname = "b"')
    (told,) = problems(LINE + VIRTUAL + other)
    assert told.startswith("error: line[2].port: this port is already used in")


def test_a_unit_that_only_a_server_line_for_all_leads_to_is_reached():
    only = '[[listen]]\nbind = "tcp://127.0.0.1:5020"\nline = "b"\n'
    lines = LINE + '[[line]]\nname = "b"\nport = "/dev/b"\ndevices = [{ unit = 2 }]\n'
    assert "no listener leads to 1" in problems(only + lines)[0]
    assert problems(only + lines + VIRTUAL) == []
