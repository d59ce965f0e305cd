"""Network addresses: scheme, host and port."""

import pytest

from gateway.config.problem import WrongValue
from gateway.config.values.address import Address, parse_address

SCHEMES = ("tcp", "tls", "rtu+tcp", "udp")
NO_NAME = "letters, digits and hyphens, in parts joined by single dots, such as plc.example"


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("tcp://0.0.0.0:502", Address("tcp", "0.0.0.0", 502)),
        ("tcp://[::]:502", Address("tcp", "::", 502)),
        ("tcp://[::ffff:127.0.0.1]:502", Address("tcp", "127.0.0.1", 502)),
        ("udp://[::ffff:7f00:1]:502", Address("udp", "127.0.0.1", 502)),
        ("tcp://[fe80::1%eth0]:502", Address("tcp", "fe80::1%eth0", 502)),
        ("tcp://plc.example:1502", Address("tcp", "plc.example", 1502)),
        ("tcp://plc_2.hall-a:1502", Address("tcp", "plc_2.hall-a", 1502)),
        ("tcp://127.0.0.1:0", Address("tcp", "127.0.0.1", 0)),
        ("tcp://10.0.0.1", Address("tcp", "10.0.0.1", 502)),
        ("tls://10.0.0.1", Address("tls", "10.0.0.1", 802)),
        ("rtu+tcp://10.0.0.1:4001", Address("rtu+tcp", "10.0.0.1", 4001)),
    ],
)
def test_scheme_host_and_port(text, address):
    assert parse_address(text, SCHEMES) == address


@pytest.mark.parametrize(
    ("value", "what", "remedy"),
    [
        (
            "0.0.0.0:502",
            "is not a valid address",
            'write it as "tcp://127.0.0.1:502"; an IPv6 address needs brackets',
        ),
        (
            "tcp://::1:502",
            "is not a valid address",
            'write it as "tcp://127.0.0.1:502"; an IPv6 address needs brackets',
        ),
        (502, "is not a valid address", 'write it as "tcp://127.0.0.1:502"; an IPv6 address needs brackets'),
        ("http://x:1", "unknown protocol http://", "it can be tcp://, tls://, rtu+tcp://, udp://"),
        ("tcp://:502", "names no host", '"tcp://0.0.0.0:502" stands for every IPv4 address'),
        ("tcp://*:502", "names no host", '"tcp://0.0.0.0:502" stands for every IPv4 address'),
        ("rtu+tcp://x", "names no port", 'write "rtu+tcp://x:PORT"'),
        ("tcp://x:70000", "port 70000 is above 65535", ""),
        ("tcp://a..b:1", "'a..b' is not a valid host name", NO_NAME),
        ("tcp://a b:1", "'a b' is not a valid host name", NO_NAME),
        ("tcp://-a:1", "'-a' is not a valid host name", NO_NAME),
        ("tcp://\u0000:1", "'\\x00' is not a valid host name", NO_NAME),
        (
            "tcp://10.0.0.256:1",
            '"10.0.0.256" is not a valid IPv4 address',
            "four numbers from 0 to 255, such as 10.2.0.7",
        ),
        ("tcp://10.0.0:1", '"10.0.0" is not a valid IPv4 address', "four numbers from 0 to 255, such as 10.2.0.7"),
        ("tcp://[::g]:1", "'::g' is not a valid IPv6 address", "such as [::1] or [fe80::1%eth0]"),
        ("tcp://[10.0.0.1]:1", "'10.0.0.1' is not a valid IPv6 address", "such as [::1] or [fe80::1%eth0]"),
        (
            "tcp://[fe80::1%lo\0x]:1",
            "'fe80::1%lo\\x00x' is not a valid IPv6 address",
            "such as [::1] or [fe80::1%eth0]",
        ),
        (
            f"tcp://[::1%{'x' * 16}]:1",
            f"'::1%{'x' * 16}' is not a valid IPv6 address",
            "such as [::1] or [fe80::1%eth0]",
        ),
    ],
)
def test_what_is_no_address_is_refused(value, what, remedy):
    with pytest.raises(WrongValue) as caught:
        parse_address(value, SCHEMES)
    assert (str(caught.value), caught.value.remedy) == (what, remedy)


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("127.8.9.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("plc", False)],
)
def test_only_loopback_addresses_are_for_this_machine_alone(host, loopback):
    assert Address("tcp", host, 502).is_loopback is loopback


@pytest.mark.parametrize(("host", "version"), [("10.0.0.1", 4), ("::", 6), ("plc", None), ("localhost", None)])
def test_a_name_may_stand_for_addresses_of_both_kinds(host, version):
    assert Address("tcp", host, 502).ip_version == version


def test_an_address_is_shown_as_it_is_written():
    assert str(Address("tcp", "10.0.0.1", 502)) == "tcp://10.0.0.1:502"
    assert str(Address("tcp", "::", 502)) == "tcp://[::]:502"
