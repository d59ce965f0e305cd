"""Values of single keys: what each kind reads, and what it refuses."""

from ipaddress import ip_network

import pytest

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address
from gateway.config.values.names import parse_name
from gateway.config.values.port import parse_format, parse_port
from gateway.config.values.profile_keys import parse_item, parse_limits
from gateway.config.values.site import parse_networks
from gateway.config.values.unitset import check_own_unit, parse_unit0, parse_units_or_all
from gateway.timing.characters import CharacterFormat


@pytest.mark.parametrize(
    ("parse", "value", "meaning"),
    [
        (parse_name, "drive-*", "drive-*"),
        (parse_name, "Förderband 3", "Förderband 3"),
        (parse_format, "8E1", CharacterFormat(8, "E", 1)),
        (parse_format, "7o1", CharacterFormat(7, "O", 1)),
        (parse_port, "/dev/ttyUSB0", "/dev/ttyUSB0"),
        (parse_port, "rtu+tcp://10.0.0.1:4001", Address("rtu+tcp", "10.0.0.1", 4001)),
        (parse_unit0, "refuse", "refuse"),
        (parse_unit0, "broadcast", "broadcast"),
        (parse_unit0, 5, 5),
        (parse_unit0, 255, 255),
        (check_own_unit, 247, 247),
        (check_own_unit, 255, 255),
        (parse_item, 65535, 65535),
        (parse_item, True, 1),
        (parse_limits, {"3": 99}, {3: 99}),
        (parse_networks, ["10.2.0.0/24", "::1"], (ip_network("10.2.0.0/24"), ip_network("::1/128"))),
        (parse_networks, ["::ffff:10.2.0.0/120", "::/0"], (ip_network("10.2.0.0/24"), ip_network("::/0"))),
        (parse_units_or_all, "all", "all"),
        (parse_units_or_all, "1-2", (1, 2)),
        (parse_units_or_all, ["1-2", 255], (1, 2, 255)),
    ],
)
def test_what_a_value_means(parse, value, meaning):
    assert parse(value) == meaning


@pytest.mark.parametrize(
    ("parse", "value", "what"),
    [
        (parse_name, "", "must have 1 to 64 visible characters, and no space around them"),
        (parse_name, " a", "must have 1 to 64 visible characters, and no space around them"),
        (parse_name, "a\nb", "must have 1 to 64 visible characters, and no space around them"),
        (parse_name, "..", "cannot be a part of the address of a page"),
        (parse_name, "a" * 65, "must have 1 to 64 visible characters, and no space around them"),
        (parse_format, "9E1", '"9E1" is not a valid character format'),
        (parse_port, "ttyUSB0", '"ttyUSB0" is not an absolute path'),
        (parse_port, "COM3", '"COM3" is not an absolute path'),
        (parse_port, "/dev/x\0", "has characters that cannot be seen"),
        (parse_port, "/dev/x\x1b[2J", "has characters that cannot be seen"),
        (parse_port, "tcp://10.0.0.1:502", "unknown protocol tcp://"),
        (parse_unit0, "ignore", 'must be "refuse", "broadcast" or a unit, 1-247 or 255'),
        (check_own_unit, 0, "0 is neither 1-247 nor 255"),
        (check_own_unit, 248, "248 is neither 1-247 nor 255"),
        (parse_unit0, 254, 'must be "refuse", "broadcast" or a unit, 1-247 or 255'),
        (parse_unit0, 0, 'must be "refuse", "broadcast" or a unit, 1-247 or 255'),
        (parse_unit0, True, 'must be "refuse", "broadcast" or a unit, 1-247 or 255'),
        (parse_item, 65536, "must be 0 to 65535, or for coils true or false"),
        (parse_item, -1, "must be 0 to 65535, or for coils true or false"),
        (parse_item, "1", "must be 0 to 65535, or for coils true or false"),
        (parse_limits, 99, "must be a table"),
        (parse_limits, {"x": 99}, '"x" is not a valid function number'),
        (parse_limits, {"128": 99}, '"128" is not a valid function number'),
        (parse_limits, {"3": 1, "03": 2}, "function 3 is there twice"),
        (parse_limits, {"3": 0}, "the limit of function 3 must be a whole number from 1"),
        (parse_limits, {"3": True}, "the limit of function 3 must be a whole number from 1"),
        (parse_networks, "10.2.0.0/24", "must be a list"),
        (parse_networks, [5], "5 is not a valid network"),
        (parse_networks, ["10.2.0.0/33"], '"10.2.0.0/33" is not a valid network'),
        (
            parse_networks,
            ["10.2.0.1/24"],
            '"10.2.0.1/24" is an address in the network 10.2.0.0/24, and not that network',
        ),
    ],
)
def test_what_is_refused(parse, value, what):
    with pytest.raises(WrongValue) as caught:
        parse(value)
    assert str(caught.value) == what


@pytest.mark.parametrize("parse", [parse_name, parse_format, parse_port])
def test_what_lacks_its_quotes_is_told_apart(parse):
    with pytest.raises(NotText):
        parse(80.0)


@pytest.mark.parametrize(
    ("port", "remedy"),
    [
        ("ttyUSB0", 'did you mean "/dev/ttyUSB0"?'),
        ("COM3", "modbus-gateway ports lists those of this machine"),
        ("10.1.0.9:4001", 'did you mean "rtu+tcp://10.1.0.9:4001"?'),
        ("[fe80::1]:4001", 'did you mean "rtu+tcp://[fe80::1]:4001"?'),
    ],
)
def test_what_is_said_of_a_port_without_a_path(port, remedy):
    with pytest.raises(WrongValue) as wrong:
        parse_port(port)
    assert wrong.value.remedy == remedy
