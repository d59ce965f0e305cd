"""A Modbus TCP server at a real socket, with the manners of real ones: it needs pauses, loses requests, leaves.

    with TcpServer(Manners(gap=0.05)) as server:
        ...  # at 127.0.0.1, port server.number

Values say what was asked: unit, and the low byte of the address. It never answers anything else, but what it answers
may come late, twice, in any order or under identifier 0.
"""

import asyncio
import random
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import Self

from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from kit.process import PATIENCE


@dataclass(frozen=True, kw_only=True)
class Manners:
    """How a server behaves. Times in seconds; without any of them it answers each request at once."""

    #: An answer takes up to so long: answers may overtake each other.
    slowness: float = 0.0
    #: A request that comes sooner after an answer is lost, or while another one is being answered; None: it is not.
    gap: float | None = None
    #: A request that comes sooner after connecting ends the connection.
    settling: float = 0.0
    #: Each so many-th request is lost.
    loses_each: int = 0
    #: So many connections are kept; another one is closed at once, or with `newest_stays` the oldest is.
    connections: int = 100
    newest_stays: bool = False
    #: Answers come under identifier 0, whatever the request's is.
    knows_identifiers: bool = True
    #: Each answer comes twice.
    repeats: bool = False


class TcpServer:
    """The server, in a thread of its own. `heard` are the requests it got, `lost` those that it did not answer.

    Tests may change `is_deaf` (requests are heard and not answered), `is_asleep` (the next request is lost, and wakes
    it) and `holds` (answers are kept until `release`) at any time.
    """

    def __init__(self, manners: Manners | None = None) -> None:
        self.manners = manners or Manners()
        self.heard: list[tuple[int, bytes]] = []
        self.lost: list[tuple[int, bytes]] = []
        self.connections = 0
        self.is_deaf = self.is_asleep = self.holds = False
        self._open: list[_Connection] = []
        self._held: list[Callable[[], None]] = []
        self._chance = random.Random(7)

    @property
    def open_connections(self) -> int:
        """Number of connections at the moment."""
        return len(self._open)

    def release(self) -> None:
        """Send what was held, and hold nothing more."""
        self.holds = False
        held, self._held = self._held, []
        for send in held:
            self._loop.call_soon_threadsafe(send)

    def hang_up(self) -> None:
        """Close all connections in order."""
        for connection in [*self._open]:
            self._loop.call_soon_threadsafe(connection.close)

    def __enter__(self) -> Self:
        ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(ready)), name="Modbus TCP server")
        self._thread.start()
        assert ready.wait(PATIENCE)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    async def _serve(self, ready: threading.Event) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        server = await self._loop.create_server(lambda: _Connection(self), "127.0.0.1", 0)
        self.number = server.sockets[0].getsockname()[1]
        ready.set()
        await self._stop.wait()
        server.close()
        for connection in [*self._open]:
            connection.close()

    # --- what its connections see ---

    def connected(self, connection: "_Connection") -> None:
        """Keep a connection, or close it or another one."""
        self.connections += 1
        self._open.append(connection)
        if len(self._open) > self.manners.connections:
            (self._open[0] if self.manners.newest_stays else connection).close()

    def left(self, connection: "_Connection") -> None:
        """Forget a connection."""
        with suppress(ValueError):
            self._open.remove(connection)

    def loses(self, asked: TcpFrame, *, is_too_soon: bool) -> bool:
        """Hear a request; tell whether it is lost."""
        self.heard.append((asked.unit, asked.pdu))
        each = self.manners.loses_each
        is_lost = is_too_soon or self.is_deaf or self.is_asleep or bool(each and len(self.heard) % each == 0)
        self.is_asleep = False
        if is_lost:
            self.lost.append((asked.unit, asked.pdu))
        return is_lost

    def send_later(self, send: Callable[[], None]) -> None:
        """Send an answer when it is time."""
        if self.holds:
            self._held.append(send)
        elif self.manners.slowness:
            self._loop.call_later(self._chance.uniform(0.0, self.manners.slowness), send)
        else:
            send()


class _Connection(asyncio.Protocol):
    """One connection. Who asks too soon is not heard."""

    def __init__(self, server: TcpServer) -> None:
        self._server = server
        self._framer = MbapFramer()
        self._opened_at = monotonic()
        self._answered_at = 0.0
        self._is_answering = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport: asyncio.Transport = transport  # type: ignore[assignment]
        self._server.connected(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.left(self)

    def data_received(self, data: bytes) -> None:
        if monotonic() - self._opened_at < self._server.manners.settling:
            self.close()
            return
        for asked in self._framer.cut(data):
            if not self._server.loses(asked, is_too_soon=self._is_too_soon()):
                self._is_answering = True
                self._server.send_later(lambda asked=asked: self._answer(asked))

    def close(self) -> None:
        self._server.left(self)
        self._transport.close()

    def _is_too_soon(self) -> bool:
        gap = self._server.manners.gap
        return gap is not None and (self._is_answering or monotonic() - self._answered_at < gap)

    def _answer(self, asked: TcpFrame) -> None:
        manners = self._server.manners
        identifier = asked.transaction if manners.knows_identifiers else 0
        self._is_answering, self._answered_at = False, monotonic()
        self._transport.write(encode(identifier, asked.unit, _response(asked)) * (1 + manners.repeats))


def _response(asked: TcpFrame) -> bytes:
    """Each register holds the unit and the low byte of its address; a write is acknowledged."""
    function, first, count = asked.pdu[0], int.from_bytes(asked.pdu[1:3]), int.from_bytes(asked.pdu[3:5])
    if function not in {3, 4}:
        return asked.pdu[:5]
    registers = b"".join(bytes((asked.unit, address & 0xFF)) for address in range(first, first + count))
    return bytes((function, len(registers))) + registers
