"""What sockets are called, and what an operator hears of their errors. Sockets themselves: tests/system/test_tcp.py."""

import errno
import socket

import pytest

from gateway.listeners.sockets import plain, why, written


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
    assert written(host, 502) == text


@pytest.mark.parametrize(
    ("host", "text"),
    [("10.0.0.7", "10.0.0.7"), ("::ffff:10.0.0.7", "10.0.0.7"), ("::1", "::1"), ("fe80::1%eth0.5", "fe80::1%eth0.5")],
)
def test_rights_see_the_address_of_an_ipv4_client_as_such(host: str, text: str) -> None:
    assert plain(host) == text


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (OSError(errno.EADDRNOTAVAIL, "whatever"), "this machine has no such address"),
        (OSError(errno.ENETDOWN, "whatever"), "network is down"),
        (socket.gaierror(socket.EAI_NONAME, "Name or service not known"), "name or service not known"),
        (UnicodeEncodeError("idna", "a..b", 2, 3, "label empty"), "this is no host name"),
    ],
)
def test_errors_are_said_in_words(error: OSError | UnicodeError, text: str) -> None:
    assert why(error) == text
