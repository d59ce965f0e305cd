"""A broker, byte by byte, that does what a test says, and the connection of a gateway to it."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from gateway.plant.client import BrokerSettings, Version
from gateway.plant.connection import BrokerConnection
from gateway.plant.messages import Delivery, Message
from kit.process import PATIENCE

CONNECT, PUBLISH, SUBSCRIBE, UNSUBSCRIBE = 0x10, 0x30, 0x80, 0xA0
CONNACK, PUBACK, SUBACK, UNSUBACK, DISCONNECT = 0x20, 0x40, 0x90, 0xB0, 0xE0
PINGRESP = bytes((0xD0, 0))


def packet(kind: int, content: bytes, properties: bytes | None = None) -> bytes:
    """A packet of less than 128 bytes, with properties if it has such."""
    if properties is not None:
        content += bytes((len(properties),)) + properties
    return bytes((kind, len(content))) + content


ACCEPTED = {"5": packet(CONNACK, bytes(2), b""), "3.1.1": packet(CONNACK, bytes(2))}


class Peer:
    """A broker that answers a login with `connack`, and says nothing else by itself. `packets` are what came."""

    def __init__(self, connack: bytes) -> None:
        self.packets: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()
        self.writer: asyncio.StreamWriter | None = None
        self._connack = connack

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

    def say(self, what: bytes) -> None:
        """Send bytes."""
        self.writer.write(what)

    @staticmethod
    def number(publication: bytes) -> bytes:
        """The number of a message."""
        return publication[2 + publication[1] :][:2]


@asynccontextmanager
async def closed(
    version: Version = "5",
    connack: bytes = b"",
    deliver: Callable[[Delivery], None] = lambda _: None,
    confirmed: Callable[[Message, str, bool], None] = lambda *_: None,
) -> AsyncIterator[tuple[BrokerConnection, Peer]]:
    """A connection that is not open yet, and its broker."""
    peer = Peer(connack or ACCEPTED[version])
    server = await asyncio.start_server(peer.serve, "127.0.0.1", 0)
    settings = BrokerSettings("127.0.0.1", server.sockets[0].getsockname()[1], "", "mbgw-test")
    connection = BrokerConnection(
        settings, version, Message("gone", b""), deliver=deliver, confirmed=confirmed, unix=lambda: 0.0
    )
    try:
        yield connection, peer
    finally:
        connection.close()
        if peer.writer is not None:
            peer.writer.close()
        server.close()
        await server.wait_closed()


@asynccontextmanager
async def connected(
    version: Version = "5", connack: bytes = b"", **callbacks: Callable[..., None]
) -> AsyncIterator[tuple[BrokerConnection, Peer]]:
    """A connection that is open, and its broker."""
    async with closed(version, connack, **callbacks) as (connection, peer):
        await connection.open()
        yield connection, peer


async def until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so."""
    async with asyncio.timeout(PATIENCE):
        while not is_so():  # noqa: ASYNC110 - the connection tells nobody else
            await asyncio.sleep(0.005)
