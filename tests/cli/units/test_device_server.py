"""What a device server sends before it is asked."""

import socket
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from threading import Thread
from types import SimpleNamespace

import pytest

from gateway.cli.units import device_server
from gateway.errors import PortError

Ends = tuple[socket.socket, socket.socket]


@pytest.fixture
def ends() -> Iterator[Ends]:
    """Our end of a connection, and that of the device server."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


@pytest.fixture
def stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process stands still for longer than the latency whenever it looks at the clock."""
    monkeypatch.setattr(device_server, "time", SimpleNamespace(monotonic=count(step=10).__next__))


@pytest.mark.usefixtures("stands_still")
def test_what_has_arrived_is_dropped_even_if_the_process_stands_still(ends: Ends) -> None:
    ours, theirs = ends
    theirs.sendall(b"left over")
    device_server.settle(ours, "port")
    ours.setblocking(False)
    with pytest.raises(BlockingIOError):
        ours.recv(1)


@pytest.mark.usefixtures("stands_still")
def test_a_closed_connection_is_noticed_even_if_the_process_stands_still(ends: Ends) -> None:
    ours, theirs = ends
    theirs.close()
    with pytest.raises(PortError, match="closes it at once"):
        device_server.settle(ours, "port")


def test_a_server_that_sends_without_end_is_not_waited_for(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = ends
    monkeypatch.setattr(device_server, "NETWORK_LATENCY", 0.05)
    sending = Thread(target=_send_without_end, args=(theirs,))
    sending.start()
    device_server.settle(ours, "port")
    ours.close()
    sending.join()


def _send_without_end(connection: socket.socket) -> None:
    with suppress(OSError):
        while True:
            connection.sendall(bytes(1000))
