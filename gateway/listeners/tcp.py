"""TCP: the listening sockets, and those who come through them."""

import asyncio
import socket
from typing import Final

from gateway import events
from gateway.listeners.admission import MADE_ROOM, Admission
from gateway.listeners.connection import TcpConnection
from gateway.listeners.origin import Origins
from gateway.listeners.session import NOT_MEANT, Counts, ListenSettings
from gateway.listeners.sockets import (
    BACKLOG,
    OpenSockets,
    addresses,
    bound_address,
    bound_sockets,
    cannot_listen,
    is_meant,
    plain,
    why,
    written,
)
from gateway.listeners.spare_descriptor import SpareDescriptor
from gateway.ports.lookup import AddressInfo
from gateway.routing.router import Router

#: How long a connection that is being closed may take to send what it still has, in seconds.
CLOSING_DEADLINE: Final = 2.0
#: How often a listener looks for connections that cannot be kept, in seconds: all their deadlines hold within that.
SWEEP_STEP: Final = 0.25
#: How long nobody is accepted when that has failed for good, in seconds.
ACCEPT_PAUSE: Final = 0.1


class TcpListener:
    """One `[[listen]]` table: binds, accepts clients, closes those that cannot be kept.

    `connections` are those that count for `clients`. One that is being closed counts no more; what was sent to its
    client has CLOSING_DEADLINE to leave.
    """

    def __init__(self, settings: ListenSettings, router: Router, emit: events.Emit) -> None:
        self.settings = settings
        self.router = router
        self.emit = emit
        self.counts = Counts()
        self.connections: Admission[TcpConnection] = Admission(Origins().of)
        self._closing: dict[TcpConnection, float] = {}
        self._addresses: list[AddressInfo] = []
        self._sockets: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._spare_descriptor = SpareDescriptor()
        self._sweeping: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        """The bound address, `tcp://127.0.0.1:5020`; the configured one while it is not bound."""
        return bound_address(self.settings, self._sockets)

    @property
    def sockets(self) -> tuple[socket.socket, ...]:
        """The bound sockets: another listener at the same address can take them over."""
        return tuple(self._sockets)

    @property
    def clients(self) -> int:
        """Connections that count for the bound."""
        return len(self.connections)

    @property
    def connected_clients(self) -> tuple[TcpConnection, ...]:
        """Who they are."""
        return tuple(self.connections)

    @property
    def has_clients(self) -> bool:
        """Whether any connection is open, or being closed."""
        return bool(len(self.connections) or self._closing)

    async def find(self) -> None:
        """Look up the addresses to be bound.

        Raises:
            ListenError: nobody knows the host's name.
        """
        self._addresses = await addresses(self.settings, socket.SOCK_STREAM)

    def bind(self, ready: OpenSockets | None = None) -> None:
        """Take the addresses without letting anybody come; sockets that are `ready` for them are used.

        Raises:
            ListenError: one is in use, needs more rights, or is no address of this machine.
        """
        self._sockets = bound_sockets(self.settings, self._addresses, ready)
        self._spare_descriptor.hold()

    def listen(self) -> None:
        """Let clients come, and wait until they are accepted.

        Raises:
            ListenError: another socket on this port was quicker.
        """
        try:
            for listening in self._sockets:
                listening.listen(BACKLOG)
        except OSError as error:
            raise cannot_listen(self.settings, error) from error

    def start(self) -> None:
        """Accept clients."""
        name = f"accept:{self.settings.name}"
        self._accepting = [asyncio.create_task(self._accept(listening), name=name) for listening in self._sockets]
        self._sweep_later()
        self.emit(events.ListenerUp(self.settings.name, self.address))

    def finish(self) -> None:
        """Accept nobody any more and take no more requests; each client is closed once it has its responses."""
        self._stop_accepting()
        for connection in self.connections:
            connection.finish()

    def close(self) -> None:
        """Accept nobody any more and drop every connection."""
        self._stop_accepting()
        if self._sweeping is not None:
            self._sweeping.cancel()
        for connection in [*self.connections, *self._closing]:
            connection.abort("the gateway ends")

    def connected(self, connection: TcpConnection) -> None:
        """A client has connected."""
        self.counts.accepted += 1
        self.connections.enter(connection, _now())
        self.emit(events.ClientConnected(self.settings.name, connection.client))

    def closing(self, connection: TcpConnection) -> None:
        """A connection is being closed: its place is free."""
        self.connections.leave(connection, _now())
        self._closing.setdefault(connection, _now() + CLOSING_DEADLINE)

    def closed(self, connection: TcpConnection, reason: str) -> None:
        """A connection has ended."""
        self.connections.leave(connection, _now())
        self._closing.pop(connection, None)
        self.emit(events.ClientClosed(self.settings.name, connection.client, reason))

    def rejected(self, client: str, reason: str) -> None:
        """A client is sent away."""
        self.counts.rejected += 1
        self.emit(events.ClientRejected(self.settings.name, client, reason))

    def failed(self, part: str, error: Exception) -> None:
        """An error that nobody foresaw has ended at one of this module's error boundaries."""
        self.emit(events.PartFailed.of(part, error))

    async def _accept(self, listening: socket.socket) -> None:
        """Take one client after the other, each in a turn of the loop of its own."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, address = await loop.sock_accept(listening)
            except OSError as error:
                await self._refuse(listening, why(error))
            else:
                await self._welcome(sock, listening, *address[:2])
            await asyncio.sleep(0)

    async def _welcome(self, sock: socket.socket, listening: socket.socket, host: str, port: int) -> None:
        host, client = plain(host), written(host, port)
        loop = asyncio.get_running_loop()
        try:
            if not is_meant(sock, listening, self._addresses):
                why_not = NOT_MEANT
            else:
                why_not = self.connections.refusal(host, self.router.rights, self.settings, loop.time(), self._dismiss)
            if not why_not:
                await loop.connect_accepted_socket(lambda: TcpConnection(self, host, client, loop.time), sock)
            else:
                sock.close()
                self.rejected(client, why_not)
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection that has just begun
            sock.close()
            self.failed(f"client {client}", error)

    async def _refuse(self, listening: socket.socket, reason: str) -> None:
        """Nobody could be accepted, most likely for lack of descriptors: those who wait must not wait for ever."""
        client = self._spare_descriptor.send_away(listening)
        self.rejected(client or "unknown", reason)
        if client is None:
            await asyncio.sleep(ACCEPT_PAUSE)

    def _dismiss(self, connection: TcpConnection) -> None:
        connection.reject(MADE_ROOM)

    def _sweep_later(self) -> None:
        self._sweeping = asyncio.get_running_loop().call_later(SWEEP_STEP, self._sweep)

    def _sweep(self) -> None:
        """Close the connections that cannot be kept, and end those that have been closing for too long."""
        now = _now()
        self.connections.look(now)
        for connection in self.connections:
            connection.look_over(now, self.settings.idle)
        for connection, deadline in list(self._closing.items()):
            if now >= deadline:
                connection.abort()
        self._sweep_later()

    def _stop_accepting(self) -> None:
        loop = asyncio.get_running_loop()
        for task in self._accepting:
            task.cancel()
        for listening in self._sockets:
            loop.remove_reader(listening)  # now: when the task has its turn, the descriptor may be somebody else's
            listening.close()
        self._accepting, self._sockets = [], []
        self._spare_descriptor.release()


def _now() -> float:
    return asyncio.get_running_loop().time()
