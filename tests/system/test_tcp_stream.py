"""An accepted TCP connection, on real sockets: what it promises its user, and what a session makes of it."""

import asyncio
import socket
import struct
import time
from contextlib import closing

import pytest

from gateway.errors import QueueFull
from gateway.listeners.connection import TcpConnection
from gateway.listeners.session import ListenSettings
from gateway.listeners.tcp_stream import TcpStream
from gateway.modbus.mbap import encode
from gateway.request import Request
from kit.process import PATIENCE

READ, RESPONSE = bytes.fromhex("03 0000 0001"), bytes.fromhex("03 02 0007")
#: More than the system takes for a client that does not read.
A_LOT = 16 * 1024 * 1024
LIMIT = 4000


async def until(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "not within the time"
        await asyncio.sleep(0.002)


@pytest.fixture
def ends():
    """The gateway's end of a connection, and the client's."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = socket.create_connection(server.getsockname())
        accepted, _ = server.accept()
    accepted.setblocking(False)
    client.setblocking(False)
    with client, closing(accepted):
        yield accepted, client


def reset(client):
    """Leave as a process does that is killed with bytes unread."""
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def take(client):
    """What the client can read now, and whether that is all there will be."""
    taken = b""
    while True:
        try:
            data = client.recv(1 << 20)
        except BlockingIOError:
            return taken, False
        except ConnectionResetError:
            return taken, True
        if not data:
            return taken, True
        taken += data


class Slow:
    """A target that answers when it is told to."""

    def __init__(self):
        self.waiting = []

    def submit(self, request: Request, now: float) -> None:
        self.waiting.append(request)


class Listener:
    """Notes what becomes of its connection."""

    def __init__(self):
        self.settings = ListenSettings("scada", "127.0.0.1", 0)
        self.failures = []
        self.reasons = []
        self.left = []

    def connected(self, connection):
        pass

    def closing(self, connection):
        pass

    def closed(self, connection, reason):
        self.reasons.append(reason)

    def rejected(self, client, reason):
        raise AssertionError(reason)

    def left_early(self, host, waited):
        self.left.append(host)

    def failed(self, part, error):
        self.failures.append((part, error))


class Served:
    """A client of a listener."""

    def __init__(self, accepted):
        loop = asyncio.get_running_loop()
        self.target, self.listener = Slow(), Listener()
        self.connection = TcpConnection(self.listener, "127.0.0.1", "127.0.0.1:1", loop.time, self.target)
        self.stream = TcpStream(loop, accepted, self.connection)
        self.connection.connection_made(self.stream)
        self.stream.resume_reading()


# --- with a session ---


async def test_a_client_whose_waiting_request_was_displaced_goes_on(ends):
    """It is held back, and sends more than there is room for; that there is no room is no end of its side."""
    accepted, client = ends
    served = Served(accepted)
    target = served.target
    client.send(b"".join(encode(number, 1, READ) for number in range(2)))
    await until(lambda: len(target.waiting) == 2)
    target.waiting.pop(0).fail(QueueFull())
    client.send(b"".join(encode(number, 1, READ) for number in range(2, 200)))
    for number in range(1, 200):
        await until(lambda: target.waiting)
        assert target.waiting[0].transaction == number
        assert served.connection.session.takes_responses
        target.waiting.pop(0).respond(RESPONSE)
    assert served.listener.reasons == []


async def test_the_stream_of_a_session_without_room_is_not_at_its_end(ends):
    accepted, client = ends
    served = Served(accepted)
    client.send(b"".join(encode(number, 1, READ) for number in range(200)))
    await until(lambda: len(served.target.waiting) == 16)
    served.stream.resume_reading()  # before the session has gone on
    await asyncio.sleep(0.02)
    assert served.connection.session.takes_responses
