"""What sockets are called, and what an operator hears of their errors. Sockets themselves: tests/system/test_tcp.py."""

import errno
import socket
from collections.abc import Iterator

import pytest

from gateway.errors import ListenError
from gateway.listeners.hosts import join_host_port, show_host
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import OpenSockets, bind_sockets, explain, make_listen_error, show_bound_address
from kit.ipv6 import needs_ipv6


@pytest.mark.parametrize(
    ("host", "text"),
    [
        ("10.0.0.7", "10.0.0.7:502"),
        ("::1", "[::1]:502"),
        ("fe80::1%eth0", "[fe80::1%eth0]:502"),
        ("::ffff:10.0.0.7", "10.0.0.7:502"),
        ("::ffff:1", "[::ffff:1]:502"),
    ],
)
def test_addresses_are_written_as_people_write_them(host: str, text: str) -> None:
    assert join_host_port(host, 502) == text


@pytest.mark.parametrize(
    ("host", "text"),
    [("10.0.0.7", "10.0.0.7"), ("::ffff:10.0.0.7", "10.0.0.7"), ("::1", "::1"), ("fe80::1%eth0.5", "fe80::1%eth0.5")],
)
def test_rights_see_the_address_of_an_ipv4_client_as_such(host: str, text: str) -> None:
    assert show_host(host) == text


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OSError(errno.EADDRNOTAVAIL, "whatever"), "this machine has no such address"),
        (OSError(errno.ENETDOWN, "whatever"), "network is down"),
        (socket.gaierror(socket.EAI_NONAME, "Name or service not known"), "name or service not known"),
        (socket.gaierror(socket.EAI_AGAIN, "Temporary failure"), "no name server answers"),
        (UnicodeEncodeError("idna", "a..b", 2, 3, "label empty"), "this is not a valid host name"),
    ],
)
def test_errors_are_said_in_words(error: OSError | UnicodeError, text: str) -> None:
    assert explain(error) == text


@pytest.fixture
def ours() -> Iterator[socket.socket]:
    """A socket of systemd."""
    with socket.create_server(("127.0.0.1", 0)) as sock:
        yield sock


@pytest.mark.parametrize("number", [errno.EACCES, errno.EADDRINUSE])
def test_a_port_that_systemd_has_is_given_away_in_its_unit(ours: socket.socket, number: int) -> None:
    port = ours.getsockname()[1]
    told = make_listen_error(ListenSettings("scada", "10.2.0.1", port), OSError(number, ""), OpenSockets([ours]))
    assert str(told) == (
        f"cannot listen on tcp://10.2.0.1:{port}: tcp://127.0.0.1:{port} has this port, by modbus-gateway.socket: "
        f"name that address, or change it there to ListenStream=10.2.0.1:{port}, "
        "then systemctl restart modbus-gateway.socket"
    )


@pytest.mark.parametrize(
    ("scheme", "host", "stream"),
    [("tcp", "::", "ListenStream=[::]:503"), ("udp", "0.0.0.0", "ListenDatagram=0.0.0.0:503")],
)
def test_a_port_that_takes_rights_can_be_opened_by_systemd(scheme: str, host: str, stream: str) -> None:
    told = make_listen_error(ListenSettings("scada", host, 503, scheme=scheme), OSError(errno.EACCES, ""))
    assert str(told).partition(":503: ")[2] == (
        "permission denied; a port below 1024 needs root, CAP_NET_BIND_SERVICE, or a socket of systemd: "
        f"give modbus-gateway.socket {stream}, then systemctl restart modbus-gateway.socket"
    )


def test_a_port_of_another_program_is_no_matter_of_systemd(ours: socket.socket) -> None:
    told = make_listen_error(ListenSettings("scada", "::", 503), OSError(errno.EADDRINUSE, ""), OpenSockets([ours]))
    assert "another program has this port" in str(told)


@pytest.fixture
def everywhere() -> Iterator[socket.socket]:
    """A socket of systemd that takes IPv6 and IPv4, as that of the shipped unit does."""
    with socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True) as sock:
        yield sock


def opened(ready: socket.socket, host: str, *, shares_port: bool = False) -> str:
    """What a listener at `host` is called with this socket of systemd, and no right to open one of its own there."""
    port = ready.getsockname()[1]
    settings = ListenSettings("scada", host, port, shares_port=shares_port)
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST)
    (sock,) = bind_sockets(settings, found, OpenSockets([ready]))
    with sock:
        assert sock.getsockname() == ready.getsockname()
        return show_bound_address(settings, [sock])


@needs_ipv6
@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1", "::", "::1"])
def test_a_socket_at_every_address_serves_a_listener_at_one_of_them(everywhere: socket.socket, host: str) -> None:
    assert opened(everywhere, host) == f"tcp://{join_host_port(host, everywhere.getsockname()[1])}"


@needs_ipv6
@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_a_socket_of_ipv6_serves_no_listener_of_ipv4(host: str) -> None:
    with socket.create_server(("::", 0), family=socket.AF_INET6) as ipv6:
        port = ipv6.getsockname()[1]
        assert OpenSockets([ipv6]).take_wider(socket.SOCK_STREAM, (host, port)) is None


@needs_ipv6
def test_of_two_listeners_on_one_port_none_takes_what_is_for_both(everywhere: socket.socket) -> None:
    with pytest.raises(ListenError, match="has this port, by modbus-gateway") as caught:
        opened(everywhere, "127.0.0.1", shares_port=True)
    port = everywhere.getsockname()[1]
    assert str(caught.value).partition("share a port, ")[2] == (
        "each must be named there: ListenStream= (empty), then a line for each address ([::] with "
        f"BindIPv6Only=ipv6-only), such as ListenStream=127.0.0.1:{port}, then systemctl restart modbus-gateway.socket"
    )
