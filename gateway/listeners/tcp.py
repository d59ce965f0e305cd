"""TCP listeners: they bind, and keep or close the connections of their clients."""

import asyncio
import socket
from typing import Final

from gateway import events
from gateway.clock.lazy_timer import LazyTimer
from gateway.listeners.accepting import Acceptor
from gateway.listeners.admission import MADE_ROOM, NOT_MEANT, Admission
from gateway.listeners.client_counts import ClientCounts
from gateway.listeners.connection import TcpConnection
from gateway.listeners.holds import Holds
from gateway.listeners.hosts import join_host_port, show_host, split_host
from gateway.listeners.sessions.arrivals import LOOK_STEP
from gateway.listeners.settings import ListenSettings
from gateway.listeners.share_keys import ShareKeys
from gateway.listeners.sockets import (
    BACKLOG,
    OpenSockets,
    bind_sockets,
    find_addresses,
    is_meant,
    make_listen_error,
    show_bound_address,
)
from gateway.listeners.tcp_stream import TcpStream
from gateway.ports.network import AddressInfo
from gateway.request import Caller
from gateway.routing.router import Router

#: How long a connection that is being closed may still send, in seconds.
CLOSING_DEADLINE: Final = 2.0
#: Seconds between checks of the connections: the precision of all their deadlines.
SWEEP_STEP: Final = 0.25
#: The framings of serial lines have no transaction identifiers.
_WITHOUT_NUMBERS: Final = ("rtu+tcp", "ascii+tcp")


class TcpListener:
    """One `[[listen]]` table: binds, accepts clients, closes those that cannot be kept.

    A connection that is being closed no longer counts for `clients`; it may still send for CLOSING_DEADLINE.
    """

    #: The least time between two accepted clients, in seconds.
    pause_between_clients = 0.0

    def __init__(self, settings: ListenSettings, router: Router, emit: events.Emit) -> None:
        self.settings = settings
        self.router = router
        self.emit = emit
        self.counts = ClientCounts()
        self._share_keys = ShareKeys()
        #: The connections that count for `clients`.
        self.connections: Admission[TcpConnection] = Admission()
        #: The connections that are being closed, with the time when they are aborted.
        self._closing: dict[TcpConnection, float] = {}
        self._addresses: list[AddressInfo] = []
        self._acceptor = Acceptor(self._connect, self.rejected, self.pause_between_clients)
        self._sweeping: asyncio.TimerHandle | None = None
        #: Reads clients whose requests count from their arrival, while there are any.
        self._looking: LazyTimer | None = None
        self.holds = Holds()
        self._will_look = False

    @property
    def address(self) -> str:
        """The bound address, `tcp://127.0.0.1:5020`; the configured one while it is not bound."""
        return show_bound_address(self.settings, self._acceptor.sockets)

    @property
    def sockets(self) -> tuple[socket.socket, ...]:
        """The bound sockets: another listener at the same address can take them over."""
        return tuple(self._acceptor.sockets)

    @property
    def clients(self) -> int:
        """Number of connections that count for `clients`."""
        return len(self.connections)

    @property
    def connected_clients(self) -> tuple[TcpConnection, ...]:
        """The connections that count for `clients`."""
        return tuple(self.connections)

    @property
    def has_clients(self) -> bool:
        """Whether any connection is open, or being closed."""
        return bool(len(self.connections) or self._closing)

    async def find(self) -> None:
        """Look up the addresses to bind.

        Raises:
            ListenError: the host name cannot be resolved.
        """
        self._addresses = await find_addresses(self.settings, socket.SOCK_STREAM)

    def bind(self, ready: OpenSockets | None = None) -> None:
        """Bind the addresses without listening yet; `ready` sockets for them are used.

        Raises:
            ListenError: one is in use, needs more rights, or does not belong to this machine.
        """
        self._acceptor.hold(bind_sockets(self.settings, self._addresses, ready))

    def listen(self) -> None:
        """Listen, so that clients can connect; `start` accepts them.

        Raises:
            ListenError: another socket on this port was quicker.
        """
        try:
            for listening in self._acceptor.sockets:
                listening.listen(BACKLOG)
        except OSError as error:
            raise make_listen_error(self.settings, error) from error

    def start(self) -> None:
        """Accept clients."""
        self._acceptor.start(f"accept:{self.settings.name}")
        self._sweep_later()
        self.emit(events.ListenerUp(self.settings.name, self.address))

    def finish(self) -> None:
        """Accept no more clients or requests; close each client once it has its responses."""
        self._acceptor.stop()
        for connection in self.connections:
            connection.finish()

    def close(self) -> None:
        """Accept no more clients, and abort every connection."""
        self._acceptor.stop()
        if self._sweeping is not None:
            self._sweeping.cancel()
        if self._looking is not None:
            self._looking.close()
        self.holds.close()
        for connection in [*self.connections, *self._closing]:
            connection.abort("the gateway is stopping")

    def connected(self, connection: TcpConnection) -> None:
        """Count a new client."""
        self.counts.accepted += 1
        self.connections.enter(connection, _now())
        self._sweep_later()
        if self.settings.scheme in _WITHOUT_NUMBERS:
            self._look_later()
        caller = connection.caller
        self.emit(events.ClientConnected(self.settings.name, caller.client, subject=caller.subject, role=caller.role))

    def closing(self, connection: TcpConnection) -> None:
        """Stop counting a connection for `clients`: it is being closed."""
        self.connections.leave(connection)
        self._closing.setdefault(connection, _now() + CLOSING_DEADLINE)

    def closed(self, connection: TcpConnection, reason: str) -> None:
        """Forget a connection that has ended."""
        self.connections.leave(connection)
        self._closing.pop(connection, None)
        self.emit(events.ClientClosed(self.settings.name, connection.caller.client, reason))

    def rejected(self, client: str, reason: str) -> None:
        """Count a rejected client, and report it."""
        self.counts.add_rejection(split_host(client), reason, _now())
        self.emit(events.ClientRejected(self.settings.name, client, reason))

    def left_early(self, host: str, waited: float) -> None:
        """Count a client that has left before its response."""
        self.counts.add_departure(host, waited, _now())

    def failed(self, part: str, error: Exception) -> None:
        """Report an unexpected error caught at an error boundary."""
        self.emit(events.PartFailed.of(part, error))

    async def _connect(self, sock: socket.socket, listening: socket.socket, host: str, port: int) -> None:
        host, client = show_host(host), join_host_port(host, port)
        try:
            caller = Caller(client, host, self._share_keys.of(host, _now()))
            is_ours = is_meant(sock.getsockname()[0], listening, self._addresses)
            why_not = self._make_room(caller, _now()) if is_ours else NOT_MEANT
            if not why_not:
                await self._serve(sock, caller)
            else:
                sock.close()
                self.rejected(client, why_not)
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection that has just begun
            sock.close()
            self.failed(f"client {client}", error)

    def _make_room(self, caller: Caller, now: float) -> str:
        """Make room for a client, perhaps by closing another one. Return why it is rejected; empty if it is not."""
        return self.connections.make_room(caller, self.router.rights, self.settings, now, self._reject_replaced)

    async def _serve(self, sock: socket.socket, caller: Caller) -> None:
        loop = asyncio.get_running_loop()
        connection = TcpConnection(self, caller, loop.time, self.router)
        stream = TcpStream(loop, sock, connection)
        connection.connection_made(stream)
        stream.resume_reading()

    def _reject_replaced(self, connection: TcpConnection) -> None:
        connection.reject(MADE_ROOM)

    @property
    def _must_sweep(self) -> bool:
        return self.has_clients

    def _sweep_later(self) -> None:
        """Schedule the next sweep, unless it is scheduled or not needed: a gateway may have hundreds of listeners."""
        if self._sweeping is None and self._must_sweep:
            self._sweeping = asyncio.get_running_loop().call_later(SWEEP_STEP, self._sweep)

    def _sweep(self) -> None:
        """Close the connections that cannot be kept, and abort those that have been closing for too long."""
        now, self._sweeping = _now(), None
        self.connections.look(now)
        for connection in self.connections:
            connection.check_client(now, self.settings.idle)
        for connection, deadline in list(self._closing.items()):
            if now >= deadline:
                connection.abort()
        self._sweep_later()

    def _look_later(self) -> None:
        """Schedule the next reading, unless it is scheduled: new clients must not delay it."""
        if self._will_look:
            return
        if self._looking is None:
            self._looking = LazyTimer(asyncio.get_running_loop(), self._look)
        self._looking.set(_now() + LOOK_STEP)
        self._will_look = True

    def _look(self) -> None:
        """Read the clients whose requests count from their arrival."""
        self._will_look = False
        for connection in self.connections:
            connection.look()
        if len(self.connections):
            self._look_later()


def _now() -> float:
    return asyncio.get_running_loop().time()
