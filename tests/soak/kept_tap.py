"""The way of a gateway to a broker, which records what is sent there and when that is confirmed."""

import asyncio
import time
from collections.abc import Callable, Iterator
from struct import unpack_from
from typing import NamedTuple

from kit.free_port import free_port

_CONNECT, _PUBLISH, _PUBACK = 1, 3, 4


class Packet(NamedTuple):
    """A message that the gateway has sent, in its so-manyth connection."""

    at: float
    connection: int
    topic: str
    payload: bytes
    qos: int
    is_retained: bool


class Tap:
    """The gateway's way to the broker. `packets` are its messages, `confirmed` when each of them was, by its place."""

    def __init__(self, broker: int) -> None:
        self.port = free_port()
        self.packets: list[Packet] = []
        self.confirmed: dict[int, float] = {}
        self.connections = 0
        self._broker = broker
        self._server: asyncio.Server | None = None
        self._open: set[asyncio.StreamWriter] = set()

    async def open(self) -> None:
        """Let the gateway connect."""
        if self._server is None:
            self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)

    async def close(self) -> None:
        """Refuse new connections."""
        if self._server is not None:
            self._server.close()
            self._server = None
        await asyncio.sleep(0)

    async def cut(self) -> None:
        """End all connections, as a network does that has lost its way: what is on the way is lost."""
        for each in [*self._open]:
            each.transport.abort()

    async def _serve(self, gateway: asyncio.StreamReader, to_gateway: asyncio.StreamWriter) -> None:
        try:
            broker, to_broker = await asyncio.open_connection("127.0.0.1", self._broker)
        except OSError:
            to_gateway.close()
            return
        self.connections += 1
        wire = _Wire(self, self.connections)
        self._open |= {to_gateway, to_broker}
        await asyncio.gather(
            self._pass(gateway, to_broker, wire.gateway),
            self._pass(broker, to_gateway, wire.broker),
            return_exceptions=True,
        )
        self._open -= {to_gateway, to_broker}

    @staticmethod
    async def _pass(source: asyncio.StreamReader, target: asyncio.StreamWriter, look: Callable[[bytes], None]) -> None:
        """Pass on everything, and then the end."""
        try:
            while data := await source.read(65536):
                look(data)
                target.write(data)
        except OSError:
            pass
        target.close()


class _Wire:
    """What is said in one connection, both ways."""

    def __init__(self, tap: Tap, number: int) -> None:
        self._tap = tap
        self._number = number
        self._has_properties = False
        self._unconfirmed: dict[int, int] = {}
        self._from_gateway, self._from_broker = _Packets(), _Packets()

    def gateway(self, data: bytes) -> None:
        for kind, flags, body in self._from_gateway.cut(data):
            if kind == _CONNECT:
                self._has_properties = body[6] == 5
            elif kind == _PUBLISH:
                self._publish(flags, body)

    def broker(self, data: bytes) -> None:
        for kind, _, body in self._from_broker.cut(data):
            place = self._unconfirmed.pop(unpack_from(">H", body)[0], None) if kind == _PUBACK else None
            if place is not None:
                self._tap.confirmed[place] = time.time()

    def _publish(self, flags: int, body: bytes) -> None:
        qos, size = flags >> 1 & 3, unpack_from(">H", body)[0]
        at = 2 + size
        if qos:
            self._unconfirmed[unpack_from(">H", body, at)[0]] = len(self._tap.packets)
            at += 2
        if self._has_properties:
            size_of_properties, at = varint(body, at)
            at += size_of_properties
        topic = body[2 : 2 + size].decode()
        self._tap.packets.append(Packet(time.time(), self._number, topic, body[at:], qos, bool(flags & 1)))


class _Packets:
    """Cuts a stream into MQTT packets."""

    def __init__(self) -> None:
        self._data = b""

    def cut(self, data: bytes) -> Iterator[tuple[int, int, bytes]]:
        """Yield kind, flags and body of each packet that is whole now."""
        self._data += data
        while len(self._data) > 1:
            try:
                size, at = varint(self._data, 1)
            except IndexError:
                return
            if len(self._data) < at + size:
                return
            head, body, self._data = self._data[0], self._data[at : at + size], self._data[at + size :]
            yield head >> 4, head & 15, body


def varint(data: bytes, at: int) -> tuple[int, int]:
    """A number of variable length, as MQTT and Sparkplug have them, and where it ends."""
    number = shift = 0
    while True:
        number |= (data[at] & 127) << shift
        shift, at = shift + 7, at + 1
        if not data[at - 1] & 128:
            return number, at
