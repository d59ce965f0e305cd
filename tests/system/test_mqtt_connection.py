"""One connection to a broker, byte by byte: what it asks for, what counts as confirmed, what it does not take."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import asynccontextmanager

import pytest
from paho.mqtt.client import Client

from gateway.plant.client import LARGEST_PACKET, BrokerSettings, Version
from gateway.plant.connection import BrokerConnection
from gateway.plant.messages import Delivery, Message
from kit.process import PATIENCE

CONNECT, PUBLISH, PUBACK, PINGREQ, DISCONNECT = 0x10, 0x30, 0x40, 0xC0, 0xE0
SESSION_TAKEN_OVER = 0x8E
CONNACK = {"5": bytes((0x20, 3, 0, 0, 0)), "3.1.1": bytes((0x20, 2, 0, 0))}
PINGRESP = bytes((0xD0, 0))
MAXIMUM_PACKET_SIZE, RECEIVE_MAXIMUM = 0x27, 0x21


class Peer:
    """A broker that does what the test says. `packets` are what came."""

    def __init__(self, connack: bytes) -> None:
        self._connack = connack
        self.packets: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()
        self.writer: asyncio.StreamWriter

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Accept one client."""
        self.writer = writer
        while head := await reader.read(1):
            size = shift = 0
            while (byte := (await reader.readexactly(1))[0]) >= 0x80:
                size, shift = size | (byte & 0x7F) << shift, shift + 7
            self.packets.put_nowait((head[0] & 0xF0, await reader.readexactly(size | byte << shift)))
            if head[0] == CONNECT:
                writer.write(self._connack)
        writer.close()

    async def next(self, kind: int, end: bytes = b"") -> bytes:
        """The content of the next packet of this kind, that ends so."""
        async with asyncio.timeout(PATIENCE):
            while True:
                found, content = await self.packets.get()
                if found == kind and content.endswith(end):
                    return content


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not is_so():  # noqa: ASYNC110 - the connection tells nobody else
            await asyncio.sleep(0.005)


@asynccontextmanager
async def connected(version: Version, deliveries: list[Delivery], *, connack=None, confirmed=lambda *_: None):
    peer = Peer(connack or CONNACK[version])
    server = await asyncio.start_server(peer.serve, "127.0.0.1", 0)
    settings = BrokerSettings("127.0.0.1", server.sockets[0].getsockname()[1], "", "mbgw-test")
    connection = BrokerConnection(
        settings, version, Message("gone", b""), deliver=deliveries.append, confirmed=confirmed, unix=lambda: 0.0
    )
    await connection.open()
    try:
        yield connection, peer
    finally:
        connection.close()
        peer.writer.close()
        server.close()
        await server.wait_closed()


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_the_answer_to_a_ping_confirms_the_messages_before_it(version):
    confirmed = []
    messages = [Message("value", str(number).encode(), qos=0) for number in range(30)]
    async with connected(version, [], confirmed=lambda *what: confirmed.append(what)) as (connection, peer):
        for message in messages:
            connection.publish(message)
        assert connection.unconfirmed == messages
        for left in (29, 0):  # the first ping was sent after the first message, the second one after all
            await peer.next(PINGREQ)
            peer.writer.write(PINGRESP)
            await until(lambda left=left: connection.in_flight == left)
        assert connection.deadline is None
        assert confirmed == [(message, "", False) for message in messages]


async def test_what_is_not_confirmed_is_known_when_the_connection_is_lost():
    """In the order of sending, whatever their QoS."""
    messages = [Message("value", str(number).encode(), qos=number % 2) for number in range(6)]
    async with connected("5", []) as (connection, peer):
        for message in messages:
            connection.publish(message)
        number = (await peer.next(PUBLISH, b"3"))[len(b"\0\5value") :][:2]
        peer.writer.write(bytes((PUBACK, 2)) + number)
        await until(lambda: connection.in_flight == 5)
        peer.writer.close()
        await connection.lost
        connection.close()
        assert connection.unconfirmed == messages[:3] + messages[4:]


async def test_the_broker_says_what_it_accepts():
    properties = bytes((RECEIVE_MAXIMUM, 0, 3, MAXIMUM_PACKET_SIZE, 0, 0, 8, 0))
    connack = bytes((0x20, 3 + len(properties), 0, 0, len(properties))) + properties
    async with connected("5", [], connack=connack) as (connection, _):
        assert connection.most_in_flight == 3
        assert connection.largest == 2048
    async with connected("5", []) as (connection, _):
        assert connection.largest == LARGEST_PACKET


async def test_it_asks_for_no_large_packets():
    async with connected("5", []) as (_, peer):
        assert bytes((MAXIMUM_PACKET_SIZE, *LARGEST_PACKET.to_bytes(4))) in await peer.next(CONNECT)


@pytest.mark.parametrize("version", ["5", "3.1.1"])
async def test_a_packet_that_is_too_large_ends_the_connection_before_it_is_read(version):
    deliveries = []
    async with connected(version, deliveries) as (connection, peer):
        small = b"\0\1t" + (b"\0" if version == "5" else b"")
        peer.writer.write(bytes((PUBLISH, len(small))) + small)
        await until(lambda: deliveries)
        peer.writer.write(bytes((PUBLISH, 0xFF, 0xFF, 0xFF, 0x7F)) + bytes(1000))
        async with asyncio.timeout(PATIENCE):
            assert await connection.lost == f"it has sent a message of more than {LARGEST_PACKET} bytes"


async def test_a_broker_may_say_that_another_client_has_taken_over_the_session():
    async with connected("5", []) as (connection, peer):
        peer.writer.write(bytes((DISCONNECT, 2, SESSION_TAKEN_OVER, 0)))
        async with asyncio.timeout(PATIENCE):
            reason = await connection.lost
        assert reason.startswith("session taken over: another client uses the same name")


async def test_an_error_of_the_library_while_it_pings_ends_the_connection(monkeypatch):
    def fail(_client: Client) -> None:
        raise OSError("broken")

    async with connected("5", []) as (connection, _):
        monkeypatch.setattr(Client, "loop_misc", fail)
        async with asyncio.timeout(PATIENCE):
            assert "broken" in await connection.lost


class Decrypted:
    """A socket with a second packet that is decrypted already, as the library wraps one for WebSockets."""

    def __init__(self, sock: socket.socket) -> None:
        self.fileno = sock.fileno
        self.close = sock.close
        self._waiting = [1]

    def pending(self) -> int:
        """How many bytes select does not know of."""
        return self._waiting.pop() if self._waiting else 0


async def test_what_is_decrypted_already_is_read_too(monkeypatch):
    async with connected("5", []) as (connection, peer):
        reads, read = [], Client.loop_read
        client = connection._client
        wrapped = Decrypted(client.socket())
        monkeypatch.setattr(client, "socket", lambda: wrapped)
        monkeypatch.setattr(client, "loop_read", lambda: (reads.append(1), read(client)))
        peer.writer.write(PINGRESP)
        await until(lambda: len(reads) == 2)
