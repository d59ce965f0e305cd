"""The connections to the page: a bounded number, shared fairly by address; none costs anything for long.

A connection counts from when the system has accepted it, with or without TLS: a client that does not finish its
handshake takes a place like any other.
"""

import asyncio
import socket
import ssl
from collections import defaultdict
from collections.abc import Callable, Container, Iterable
from errno import EADDRINUSE
from typing import Final, cast
from weakref import WeakSet

from aiohttp import web

from gateway.listeners.accepting import Acceptor
from gateway.listeners.share_keys import ShareKeys
from gateway.listeners.sockets import overlap
from gateway.ports.network import notice_vanished_peers
from gateway.web.front.pieces import InPieces
from gateway.web.front.problems import Handler
from gateway.web.front.secured import SecuredConnections
from gateway.web.front.turns import Turns

#: Connections at a time. For a new one, an address that has more than this many loses its oldest; otherwise the new one
#: is closed at once. Browsers open six.
MOST_CONNECTIONS: Final = 128
MOST_OF_ONE_ADDRESS: Final = 8
#: How long a connection may take for its first request, with its TLS handshake, in seconds.
FIRST_REQUEST_WITHIN: Final = 20.0
#: How long a client may take nothing of what is sent to it, in seconds.
UNREAD_FOR: Final = 20
#: A client that is silent for this long is probed at this interval, and closed after this many probes.
_SILENT_FOR: Final = 60
_ASKED_EVERY: Final = 10
_ASKED_TIMES: Final = 3

#: How long the next client waits at least after one was accepted, in seconds: a flood must not delay lines.
_PAUSE_BETWEEN_CLIENTS: Final = 0.002

#: The context for a connection that begins now.
Context = Callable[[], ssl.SSLContext]
#: Makes the protocol of a new connection; with a context for TLS it is served after the handshake.
Connect = Callable[[Context | None], asyncio.Protocol]


async def listen(
    host: str, port: int, connected: Callable[[], asyncio.Protocol], taken: Iterable[socket.socket] = ()
) -> Acceptor:
    """Accept clients until `stop` of the acceptor; the system disconnects those that read nothing or are gone.

    Addresses of `taken` sockets are refused, even if these do not listen yet.

    Raises:
        OSError: the address cannot be used.
    """

    async def connect(sock: socket.socket, *_: object) -> None:
        await asyncio.get_running_loop().connect_accepted_socket(connected, sock)

    server = await asyncio.get_running_loop().create_server(connected, host, port, start_serving=False)
    acceptor = Acceptor(connect, lambda *_: None, _PAUSE_BETWEEN_CLIENTS)
    acceptor.hold([each.dup() for each in server.sockets])
    server.close()  # it would accept a hundred in one turn of the loop
    try:
        _refuse_taken(acceptor.sockets, taken)
        for sock in acceptor.sockets:  # connections inherit it
            notice_vanished_peers(
                sock, idle=_SILENT_FOR, interval=_ASKED_EVERY, probes=_ASKED_TIMES, user_timeout=UNREAD_FOR * 1000
            )
            sock.setblocking(False)
            sock.listen(MOST_CONNECTIONS)
    except OSError:
        acceptor.stop()
        raise
    acceptor.start("web page")
    return acceptor


def _refuse_taken(bound: Iterable[socket.socket], taken: Iterable[socket.socket]) -> None:
    if any(overlap(one, other) for one in taken for other in bound):
        raise OSError(EADDRINUSE, "a [[listen]] has this address")


class Connections:
    """The open connections; `serve` makes the handler of one."""

    def __init__(self, serve: Callable[[], web.RequestHandler]) -> None:
        self._serve = serve
        self._secured = SecuredConnections(serve)
        #: What is open, the oldest first.
        self._open: list[_Connection] = []
        #: Those that have asked something, as their handlers know them.
        self._asked: WeakSet[asyncio.BaseTransport] = WeakSet()
        self._share_keys = ShareKeys()
        self._turns = Turns()
        self._look_again: asyncio.TimerHandle | None = None

    def connected(self, tls: Context | None = None) -> asyncio.Protocol:
        """Make the protocol of a new connection; with `tls` it is served after the handshake."""
        return _Connection(self, tls)

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Note that a connection has asked something, and begin one request per turn of the loop: lines come first."""
        if request.transport is not None:
            self._asked.add(request.transport)
        async with self._turns.turn(request):
            await asyncio.sleep(0)
        return await handler(request)

    def begin(self, new: "_Connection") -> None:
        """Serve a new connection, or close it if there is no room."""
        now = asyncio.get_running_loop().time()
        self._open = [each for each in self._open if each.is_open]
        origin = self._share_keys.of(new.host, now)
        has_room = new.tls is None or self._secured.has_room(origin, now)
        if not has_room or (len(self._open) >= MOST_CONNECTIONS and not self._make_room(now)):
            new.close()
            return
        self._open.append(new)
        new.closes_at = now + FIRST_REQUEST_WITHIN
        if self._look_again is None:
            self._look_again = asyncio.get_running_loop().call_at(new.closes_at, self._close_silent)
        if new.tls is None:
            new.hand_over(new.transport, InPieces(self._serve()))
        else:
            stream = self._secured.stream(new.tls())
            new.hand_over(stream, stream)
            self._secured.begin(stream, new.host, origin, now)

    def close(self) -> None:
        """Stop watching connections; the server closes those that are served."""
        self._secured.close()
        if self._look_again is not None:
            self._look_again.cancel()

    def _make_room(self, now: float) -> bool:
        """Close the oldest connection of the address that has most of them, or, if all have few, the oldest silent one.

        Return False if there is none.
        """
        by_origin: defaultdict[str, list[_Connection]] = defaultdict(list)
        for each in self._open:
            if not each.transport.is_closing():
                by_origin[self._share_keys.of(each.host, now)].append(each)
        most = max(by_origin.values(), key=len, default=[])
        if len(most) <= MOST_OF_ONE_ADDRESS:
            most = [each for each in self._open if not (each.transport.is_closing() or each.has_asked(self._asked))]
        for oldest in most[:1]:
            oldest.close()
        return bool(most)

    def _close_silent(self) -> None:
        """Close those that have not asked anything in time, and look again when the next one is due."""
        loop = asyncio.get_running_loop()
        self._look_again = None
        for each in self._open:
            if not each.is_open or each.has_asked(self._asked):
                continue
            if each.closes_at > loop.time():
                self._look_again = loop.call_at(each.closes_at, self._close_silent)
                return
            each.close()


class _Connection(asyncio.Protocol):
    """A connection, and its protocol until it is served. `stream` is its transport as its handler knows it."""

    transport: asyncio.Transport
    stream: asyncio.Transport

    def __init__(self, connections: Connections, tls: Context | None) -> None:
        self.closes_at = 0.0
        self.host = ""
        self.tls = tls
        self._connections = connections

    @property
    def is_open(self) -> bool:
        """Whether the system still has it: a closed one may wait for its client to take the rest."""
        sock = self.transport.get_extra_info("socket")
        return not self.transport.is_closing() if sock is None else sock.fileno() >= 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Serve it, or close it if there is no room."""
        self.transport = cast("asyncio.Transport", transport)
        host, *_ = transport.get_extra_info("peername") or ("",)
        self.host = host.partition("%")[0]
        self._connections.begin(self)

    def hand_over(self, stream: asyncio.Transport, protocol: asyncio.BaseProtocol) -> None:
        """Hand it over to a protocol, at once: some versions of Python receive although reading is paused."""
        self.stream = stream
        self.transport.set_protocol(protocol)
        protocol.connection_made(self.transport)

    def has_asked(self, asked: Container[asyncio.BaseTransport]) -> bool:
        """Return whether it is among those that have `asked`."""
        return self.stream in asked

    def close(self) -> None:
        """Close it at once."""
        self.transport.abort()
