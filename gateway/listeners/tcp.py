"""Modbus TCP: the listening socket, and the driver that joins a session to its connection."""

import asyncio
import errno
import os
import socket
import traceback
from collections.abc import Callable
from typing import cast

from gateway import events
from gateway.errors import ListenError
from gateway.listeners.session import ListenSettings, Session
from gateway.request import Target
from gateway.routing.access import may_write

#: A connection whose client takes no responses keeps at most so many bytes for it.
UNSENT_BYTES = 64 * 1024
#: Keep-alive (T 4.3.2): a peer that vanished is noticed after a minute. Seconds, seconds, probes.
KEEPALIVE_IDLE, KEEPALIVE_INTERVAL, KEEPALIVE_PROBES = 30, 10, 3
_ADVICE = {
    errno.EACCES: "permission denied; ports below 1024 need root or CAP_NET_BIND_SERVICE",
    errno.EADDRINUSE: "another program has this port, perhaps another modbus-gateway",
    errno.EADDRNOTAVAIL: "this machine has no such address",
}
#: How often idle connections are looked for, as a share of the idle time.
_SWEEPS_PER_IDLE_TIME = 10


class TcpListener:
    """One `[[listen]]` table: binds, accepts clients, closes those that have been idle for too long."""

    def __init__(self, settings: ListenSettings, router: Target, emit: events.Emit) -> None:
        self.settings = settings
        self.router = router
        self.emit = emit
        self.connections: set[TcpConnection] = set()
        self._server: asyncio.Server | None = None
        self._sweep: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        """The bound address, `tcp://127.0.0.1:5020`."""
        server = cast("asyncio.Server", self._server)
        return _url(*server.sockets[0].getsockname()[:2])

    async def bind(self) -> None:
        """Take the address without accepting anybody yet.

        Raises:
            ListenError: it is in use, needs more rights, or is no address of this machine.
        """
        loop = asyncio.get_running_loop()
        settings = self.settings
        try:
            self._server = await loop.create_server(
                lambda: TcpConnection(self, loop.time), settings.host, settings.port, start_serving=False
            )
        except OSError as error:
            address = _url(settings.host, settings.port)
            place = f"{settings.source}: " if settings.source else ""
            raise ListenError(f"{place}cannot listen on {address}: {_why(error)}") from error

    async def start(self) -> None:
        """Accept clients."""
        await cast("asyncio.Server", self._server).start_serving()
        self.emit(events.ListenerUp(self.settings.name, self.address))
        if self.settings.idle:
            self._sweep_later()

    def stop_accepting(self) -> None:
        """Accept nobody any more; connections stay."""
        if self._server is not None:
            self._server.close()
        if self._sweep is not None:
            self._sweep.cancel()

    @property
    def is_idle(self) -> bool:
        """Whether no request of any client is under way."""
        return all(connection.session.is_idle for connection in self.connections)

    def close(self) -> None:
        """Accept nobody any more and close every connection."""
        self.stop_accepting()
        for connection in list(self.connections):
            connection.close("the gateway ends")

    def make_room(self) -> bool:
        """Whether there is room for one more client, after closing the longest idle one if need be (T 4.2.1.1)."""
        if len(self.connections) < self.settings.clients:
            return True
        idle = [connection for connection in self.connections if connection.session.is_idle]
        if not idle:
            return False
        oldest = min(idle, key=lambda connection: connection.session.last_asked)
        oldest.reject("made room for another client")
        return True

    def _sweep_later(self) -> None:
        loop = asyncio.get_running_loop()
        self._sweep = loop.call_later(self.settings.idle / _SWEEPS_PER_IDLE_TIME, self._close_idle)

    def _close_idle(self) -> None:
        asked_before = asyncio.get_running_loop().time() - self.settings.idle
        for connection in list(self.connections):
            if connection.session.is_idle and connection.session.last_asked <= asked_before:
                connection.close("idle")
        self._sweep_later()


class TcpConnection(asyncio.BufferedProtocol):
    """The driver of one connection. An error that nobody foresaw ends here, and with it only this connection."""

    transport: asyncio.Transport
    session: Session

    def __init__(self, listener: TcpListener, time: Callable[[], float]) -> None:
        self._listener = listener
        self._time = time
        self._reason = "the client has closed it"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self.transport = cast("asyncio.Transport", transport)
        self.transport.set_write_buffer_limits(UNSENT_BYTES)
        _keep_alive(self.transport.get_extra_info("socket"))
        listener = self._listener
        host, port = self.transport.get_extra_info("peername")[:2]
        self.session = Session(
            _pair(host, port),
            may_write=may_write(host),
            router=listener.router,
            connection=self,
            in_flight=listener.settings.in_flight,
            now=self._time(),
        )
        if not listener.make_room():
            self.reject("too many clients, and all of them have requests under way")
            return
        listener.connections.add(self)
        listener.emit(events.ClientConnected(listener.settings.name, self.session.client))

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the session's buffer has its own size
        """Where asyncio receives into."""
        return self.session.room()

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes have arrived."""
        try:
            self.session.received(nbytes, self._time())
        except Exception as error:  # noqa: BLE001 - the border of a connection
            self._fail(error)

    def eof_received(self) -> bool:
        """The client sends no more; keep the connection until its responses have been sent."""
        self.session.end_of_input()
        return True

    def pause_writing(self) -> None:
        """The client does not take its responses."""
        self.session.block()

    def resume_writing(self) -> None:
        """The client takes its responses again."""
        self.session.unblock()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection has ended."""
        self.session.closed()
        if self in self._listener.connections:
            self._listener.connections.remove(self)
            reason = self._reason if not isinstance(exc, OSError) else f"lost: {_why(exc)}"
            self._listener.emit(events.ClientClosed(self._listener.settings.name, self.session.client, reason))

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

    def close(self, reason: str = "the client has closed it") -> None:
        """Close once everything sent has left."""
        self._reason = reason
        self.transport.close()

    def reject(self, reason: str) -> None:
        """Close because of what the client did, or because there is no room for it."""
        self._listener.emit(events.ClientRejected(self._listener.settings.name, self.session.client, reason))
        self.close(reason)

    def _proceed(self) -> None:
        if not self.session.gone:
            self.buffer_updated(0)

    def _fail(self, error: Exception) -> None:
        text = "".join(traceback.format_exception(error))
        self._listener.emit(events.PartFailed(f"client {self.session.client}", repr(error), text))
        self.session.closed()
        self.transport.abort()


def _url(host: str, port: int) -> str:
    return f"tcp://{_pair(host, port)}"


def _pair(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _why(error: OSError) -> str:
    if error.errno in _ADVICE:
        return _ADVICE[error.errno]
    if error.errno is not None and error.errno > 0:
        return os.strerror(error.errno).lower()
    return str(error.strerror).lower()


def _keep_alive(sock: socket.socket) -> None:
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_IDLE)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, KEEPALIVE_INTERVAL)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, KEEPALIVE_PROBES)
