"""Addresses where clients connect."""

import pytest

from kit.config_problems import LINE, problems


def test_two_listeners_at_one_address():
    text = (
        LINE
        + '[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:1"\n[[listen]]\nname = "y"\nbind = "tcp://127.0.0.1:1"\n'
    )
    assert problems(text) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


def test_two_listeners_may_both_take_a_free_port():
    text = (
        LINE
        + '[[listen]]\nname = "x"\nbind = "tcp://127.0.0.1:0"\n[[listen]]\nname = "y"\nbind = "tcp://127.0.0.1:0"\n'
    )
    assert problems(text) == []


@pytest.mark.parametrize(
    ("one", "other"),
    [("0.0.0.0", "127.0.0.1"), ("127.0.0.1", "0.0.0.0"), ("[::]", "[::1]"), ("0.0.0.0", "localhost"), ("a.b", "A.B")],
)
def test_a_wildcard_takes_the_port_from_every_address(one, other):
    text = LINE + f'[[listen]]\nbind = "tcp://{one}:1"\n[[listen]]\nbind = "tcp://{other}:1"\n'
    (said,) = [said for said in problems(text) if said.startswith("error")]
    assert said.startswith("error: listen[1].bind: this address is already used in gateway.toml:5")
    wildcard = next((host.strip("[]") for host in (one, other) if host in ("0.0.0.0", "[::]")), None)
    assert wildcard is None or said.endswith(f"; {wildcard} stands for every address of its kind")


@pytest.mark.parametrize("other", ["localhost", "127.0.0.1", "[::1]", "0.0.0.0", "[::]"])
@pytest.mark.parametrize("bind", ["tcp://{}:1", "http://{}:1"])
def test_localhost_is_an_address_of_both_kinds(bind, other):
    own = "[[listen]]" if bind.startswith("tcp") else '[web]\ntoken = { file = "/dev/null" }'
    text = LINE + f'[[listen]]\nbind = "tcp://localhost:1"\n{own}\nbind = "{bind.format(other)}"\n'
    (said,) = [said for said in problems(text) if said.startswith("error")]
    assert "bind: this address is already used in gateway.toml:5" in said
    if other in ("127.0.0.1", "[::1]"):
        assert said.endswith("; localhost stands for 127.0.0.1 and [::1]")


@pytest.mark.parametrize(("one", "other"), [("0.0.0.0", "[::]"), ("[::]", "127.0.0.1"), ("127.0.0.1", "10.0.0.1")])
def test_ipv4_and_ipv6_have_ports_of_their_own(one, other):
    text = LINE + f'[[listen]]\nbind = "tcp://{one}:1"\n[[listen]]\nbind = "tcp://{other}:1"\n'
    assert [said for said in problems(text) if said.startswith("error")] == []


def test_an_ipv4_address_that_is_written_as_an_ipv6_one_is_the_same_address():
    text = LINE + "".join(f'[[listen]]\nbind = "tcp://{host}:1"\n' for host in ("127.0.0.1", "[::ffff:127.0.0.1]"))
    assert problems(text) == ["error: listen[1].bind: this address is already used in gateway.toml:5"]


BOTH = '[[listen]]\nname = "x"\nbind = "{}://127.0.0.1:1"\n[[listen]]\nname = "y"\nbind = "{}://127.0.0.1:1"\n'


def test_udp_and_tcp_ports_are_not_the_same():
    assert [said for said in problems(LINE + BOTH.format("tcp", "udp")) if said.startswith("error")] == []


def test_everything_on_tcp_has_the_same_ports():
    taken = ["error: listen[1].bind: this address is already used in gateway.toml:5"]
    assert problems(LINE + BOTH.format("tcp", "rtu+tcp")) == taken
    assert problems(LINE + BOTH.format("ascii+tcp", "rtu+tcp")) == taken


@pytest.mark.parametrize("ipv4", ["127.0.0.1", "localhost"])
def test_an_ipv4_listener_leaves_the_wildcard_of_ipv6_no_ipv4_clients(ipv4):
    text = LINE + f'[[listen]]\nbind = "tcp://[::]:1"\n[[listen]]\nbind = "tcp://{ipv4}:1"\n'
    said = "takes IPv6 clients only, because gateway.toml:7 has an IPv4 address with the same port"
    remedy = 'to serve every IPv4 address, write "tcp://0.0.0.0:1" in gateway.toml:7'
    assert problems(text)[0] == f"warning: listen[0].bind: {said} | {remedy}"
    for other in ("udp://127.0.0.1:1", "tcp://127.0.0.1:2", "tcp://0.0.0.0:1", "tcp://[::1]:2", "tcp://a.b:1"):
        text = LINE + f'[[listen]]\nbind = "tcp://[::]:1"\n[[listen]]\nbind = "{other}"\n'
        assert not [one for one in problems(text) if said[:22] in one]


@pytest.mark.parametrize(
    ("one", "other", "is_told"),
    [
        ("tcp://0.0.0.0:502", "tcp://[::]:502", True),
        ("tcp://[::]:502", "rtu+tcp://10.2.0.1:502", True),
        ("tcp://10.2.0.1:502", "tcp://10.3.0.1:502", True),
        ("udp://10.2.0.1:502", "udp://[::1]:502", True),
        ("tcp://10.2.0.1:502", "udp://10.3.0.1:502", False),
        ("tcp://10.2.0.1:502", "tcp://10.3.0.1:503", False),
        ("tcp://0.0.0.0:1024", "tcp://[::]:1024", False),
        ("tcp://0.0.0.0:502", "tcp://10.2.0.1:502", False),  # an error
    ],
)
def test_a_port_of_the_socket_unit_is_not_shared_unless_that_says_so(one, other, is_told):
    text = LINE + f'[[listen]]\nbind = "{one}"\n[[listen]]\nbind = "{other}"\n'
    told = (
        "warning: listen[1].bind: the service does not start with it and gateway.toml:5, unless modbus-gateway.socket "
        'names both | its [::] takes clients of every address; for both see "Other addresses" in docs/service.md'
    )
    assert [said for said in problems(text) if "does not start" in said] == [told] * is_told
