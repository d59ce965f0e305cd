"""TCP connections: the listening socket, and the driver that joins a session to its connection."""

import asyncio
import socket
import traceback
from collections import Counter
from collections.abc import Callable
from typing import Final, cast

from gateway import events
from gateway.listeners.mbap import MbapSession
from gateway.listeners.over_tcp import OverTcpSession
from gateway.listeners.session import NO_RIGHTS, NO_ROOM, Counts, ListenSettings, Session
from gateway.listeners.sockets import (
    BACKLOG,
    OpenSockets,
    Reserve,
    cannot_listen,
    door_address,
    doors,
    plain,
    why,
    written,
)
from gateway.modbus.codes import MAX_TCP_ADU
from gateway.ports.clock import Alarm
from gateway.routing.router import Router

#: A connection whose client takes no responses keeps at most so many bytes for it.
UNSENT_BYTES: Final = 64 * 1024
#: How long a connection that is being closed may take to send what it still has, in seconds.
CLOSING_DEADLINE: Final = 2.0
#: How often a listener looks for connections that cannot be kept, in seconds: all their deadlines hold within that.
SWEEP_STEP: Final = 0.5
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
        self.connections: set[TcpConnection] = set()
        self._closing: dict[TcpConnection, float] = {}
        self._doors: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._reserve = Reserve()
        self._sweeping: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        """The bound address, `tcp://127.0.0.1:5020`; the configured one while it is not bound."""
        return door_address(self.settings, self._doors)

    @property
    def doors(self) -> tuple[socket.socket, ...]:
        """The bound sockets: another listener at the same address can take them over."""
        return tuple(self._doors)

    @property
    def clients(self) -> int:
        """Connections that count for the bound."""
        return len(self.connections)

    @property
    def has_clients(self) -> bool:
        """Whether any connection is open, or being closed."""
        return bool(self.connections or self._closing)

    async def bind(self, ready: OpenSockets | None = None) -> None:
        """Take the address without accepting anybody yet; a socket that is `ready` for it is used.

        Raises:
            ListenError: it is in use, needs more rights, or is no address of this machine.
        """
        self._doors = await doors(self.settings, socket.SOCK_STREAM, ready)
        self._reserve.hold()

    def start(self) -> None:
        """Accept clients.

        Raises:
            ListenError: another socket on this port was quicker.
        """
        try:
            for door in self._doors:
                door.listen(BACKLOG)
        except OSError as error:
            raise cannot_listen(self.settings, error) from error
        name = f"accept:{self.settings.name}"
        self._accepting = [asyncio.create_task(self._accept(door), name=name) for door in self._doors]
        self._sweep_later()
        self.emit(events.ListenerUp(self.settings.name, self.address))

    def finish(self) -> None:
        """Accept nobody any more and take no more requests; each client is closed once it has its responses."""
        self._stop_accepting()
        for connection in list(self.connections):
            connection.finish()

    def close(self) -> None:
        """Accept nobody any more and drop every connection."""
        self._stop_accepting()
        if self._sweeping is not None:
            self._sweeping.cancel()
        for connection in [*self.connections, *self._closing]:
            connection.abort("the gateway ends")

    def connected(self, connection: "TcpConnection") -> None:
        """A client has connected."""
        self.counts.accepted += 1
        self.connections.add(connection)
        self.emit(events.ClientConnected(self.settings.name, connection.client))

    def closing(self, connection: "TcpConnection") -> None:
        """A connection is being closed: its place is free."""
        self.connections.discard(connection)
        self._closing.setdefault(connection, asyncio.get_running_loop().time() + CLOSING_DEADLINE)

    def closed(self, connection: "TcpConnection", reason: str) -> None:
        """A connection has ended."""
        self.connections.discard(connection)
        self._closing.pop(connection, None)
        self.emit(events.ClientClosed(self.settings.name, connection.client, reason))

    def rejected(self, client: str, reason: str) -> None:
        """A client is sent away."""
        self.counts.rejected += 1
        self.emit(events.ClientRejected(self.settings.name, client, reason))

    def failed(self, part: str, error: Exception) -> None:
        """An error that nobody foresaw has ended at one of this module's borders."""
        self.emit(events.PartFailed(part, repr(error), "".join(traceback.format_exception(error))))

    async def _accept(self, door: socket.socket) -> None:
        """Take one client after the other, each in a turn of the loop of its own."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, address = await loop.sock_accept(door)
            except OSError as error:
                await self._refuse(door, why(error))
            else:
                await self._welcome(sock, *address[:2])
            await asyncio.sleep(0)

    async def _welcome(self, sock: socket.socket, host: str, port: int) -> None:
        host, client = plain(host), written(host, port)
        loop = asyncio.get_running_loop()
        try:
            refusal = self._refusal(host)
            if not refusal:
                await loop.connect_accepted_socket(lambda: TcpConnection(self, host, client, loop.time), sock)
            else:
                sock.close()
                self.rejected(client, refusal)
        except Exception as error:  # noqa: BLE001 - the border of a connection that has just begun
            sock.close()
            self.failed(f"client {client}", error)

    async def _refuse(self, door: socket.socket, reason: str) -> None:
        """Nobody could be accepted, most likely for want of descriptors: those who wait must not wait for ever."""
        client = self._reserve.send_away(door)
        self.rejected(client or "unknown", reason)
        if client is None:
            await asyncio.sleep(ACCEPT_PAUSE)

    def _refusal(self, host: str) -> str:
        """Why a client from this address is not let in; empty when there is a place for it now."""
        if not self.router.rights.admits(host):
            return NO_RIGHTS
        return "" if self._make_room() else NO_ROOM

    def _make_room(self) -> bool:
        """Whether there is room for one more client, after closing the longest idle one if need be (T 4.2.1.1).

        It is one of the address that has the most connections: whoever floods the listener only drives out itself.
        """
        if len(self.connections) < self.settings.clients:
            return True
        idle = [connection for connection in self.connections if connection.session.is_idle]
        if not idle:
            return False
        share = Counter(connection.host for connection in self.connections)
        oldest = min(idle, key=lambda each: (-share[each.host], each.session.last_asked))
        oldest.reject("made room for another client")
        return True

    def _sweep_later(self) -> None:
        self._sweeping = asyncio.get_running_loop().call_later(SWEEP_STEP, self._sweep)

    def _sweep(self) -> None:
        """Close the connections that cannot be kept, and end those that have been closing for too long."""
        now = asyncio.get_running_loop().time()
        for connection in list(self.connections):
            connection.look_over(now, self.settings.idle)
        for connection, deadline in list(self._closing.items()):
            if now >= deadline:
                connection.abort()
        self._sweep_later()

    def _stop_accepting(self) -> None:
        loop = asyncio.get_running_loop()
        for task in self._accepting:
            task.cancel()
        for door in self._doors:
            loop.remove_reader(door)  # now: when the task has its turn, the descriptor may be somebody else's
            door.close()
        self._accepting, self._doors = [], []
        self._reserve.release()


class TcpConnection(asyncio.BufferedProtocol):
    """The driver of one connection. An error that nobody foresaw ends here, and with it only this connection."""

    transport: asyncio.Transport
    session: Session

    def __init__(self, listener: TcpListener, host: str, client: str, time: Callable[[], float]) -> None:
        """`host` is the peer's address and decides what it may do; `client` is what events call it."""
        self.host = host
        self.client = client
        self._listener = listener
        self._time = time
        self._reason = "the client has closed it"
        self._alarm: Alarm | None = None
        session = MbapSession if listener.settings.scheme == "tcp" else OverTcpSession
        self.session = session(
            client,
            host=host,
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=time(),
        )

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self.transport = cast("asyncio.Transport", transport)
        # those that are under way when reading stops are answered too
        room = UNSENT_BYTES - self._listener.settings.in_flight * MAX_TCP_ADU
        self.transport.set_write_buffer_limits(max(room, 0))
        self._listener.connected(self)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the session's buffer has its own size
        """Where asyncio receives into."""
        return self.session.room()

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes have arrived."""
        try:
            self.session.received(nbytes, self._time())
        except Exception as error:  # noqa: BLE001 - the border of a connection
            self._failed(error)

    def eof_received(self) -> bool:
        """The client sends no more; keep the connection until its responses have been sent."""
        self.session.end_of_input()
        return True

    def pause_writing(self) -> None:
        """The client does not take its responses."""
        self.session.block(self._time())

    def resume_writing(self) -> None:
        """The client takes its responses again."""
        self.session.unblock()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection has ended."""
        self.session.closed()
        if self._alarm is not None:
            self._alarm.close()
        self._listener.closed(self, f"lost: {why(exc)}" if isinstance(exc, OSError) else self._reason)

    def send(self, data: bytes) -> None:
        """Send a response; not to a client that has gone, of whom asyncio may not have told yet."""
        if not self.transport.is_closing():
            self.transport.write(data)

    def pause(self) -> None:
        """Receive nothing more until `resume`."""
        self.transport.pause_reading()

    def resume(self) -> None:
        """Receive again, and look at what is there already."""
        self.transport.resume_reading()
        asyncio.get_running_loop().call_soon(self._proceed)

    def wake(self, when: float | None) -> None:
        """Look at what is there already at `when`, not at all when that is None."""
        if self._alarm is None:
            self._alarm = Alarm(asyncio.get_running_loop(), self._proceed)
        self._alarm.set(when)

    def close(self) -> None:
        """Close once everything sent has left, or the deadline for that has passed."""
        self._listener.closing(self)
        self.transport.close()

    def reject(self, reason: str) -> None:
        """Close because of what the client did, or because another one needs the place."""
        self._listener.rejected(self.client, reason)
        self._part(reason)

    def look_over(self, now: float, idle: float) -> None:
        """Close when the client cannot be kept: for what it does, or because it asked nothing for `idle` seconds."""
        complaint = self.session.complaint(now)
        if complaint:
            self.reject(complaint)
        elif idle and self.session.is_idle and now - self.session.last_asked >= idle:
            self._part("idle")

    def finish(self) -> None:
        """Take no more requests; close when those under way have been answered."""
        self._reason = "the gateway ends"
        self.session.finish()

    def abort(self, reason: str = "") -> None:
        """End it now, whatever has not been sent."""
        self._reason = reason or self._reason
        self.session.closed()
        self._listener.closing(self)
        self.transport.abort()

    def _part(self, reason: str) -> None:
        """Close, and drop what the client still waits for."""
        self._reason = reason
        self.session.closed()
        self.close()

    def _proceed(self) -> None:
        if self.session.gone:
            return
        try:
            self.session.proceed(self._time())
        except Exception as error:  # noqa: BLE001 - the border of a connection
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self._listener.failed(f"client {self.client}", error)
        self.abort("a defect in the gateway")
