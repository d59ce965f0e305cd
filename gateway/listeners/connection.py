"""The driver of a TCP connection: it joins a session to it."""

import asyncio
import os
from collections.abc import Callable
from typing import Final, Protocol, cast

from gateway.listeners.mbap import MbapSession
from gateway.listeners.over_tcp import OverTcpSession
from gateway.listeners.session import ListenSettings, Session
from gateway.listeners.sockets import why
from gateway.modbus.codes import MAX_TCP_ADU
from gateway.ports.lazy_timer import LazyTimer
from gateway.routing.router import Router

#: A connection whose client takes no responses keeps at most so many bytes for it.
UNSENT_BYTES: Final = 64 * 1024


class ConnectionOwner(Protocol):
    """Who accepted a connection: its listener."""

    settings: ListenSettings
    router: Router

    def connected(self, connection: "TcpConnection") -> None:
        """A client has connected."""

    def closing(self, connection: "TcpConnection") -> None:
        """A connection is being closed: its place is free."""

    def closed(self, connection: "TcpConnection", reason: str) -> None:
        """A connection has ended."""

    def rejected(self, client: str, reason: str) -> None:
        """A client is sent away."""

    def failed(self, part: str, error: Exception) -> None:
        """An error that nobody foresaw has ended at the error boundary of a connection."""


class TcpConnection(asyncio.BufferedProtocol):
    """The driver of one connection. An error that nobody foresaw ends here, and with it only this connection."""

    transport: asyncio.Transport
    session: Session

    def __init__(self, listener: ConnectionOwner, host: str, client: str, time: Callable[[], float]) -> None:
        """`host` is the peer's address and decides what it may do; `client` is what events call it."""
        self.host = host
        self.client = client
        self._listener = listener
        self._time = time
        self._came_at = time()
        self._reason = "the client has closed it"
        self._timer: LazyTimer | None = None
        session = MbapSession if listener.settings.scheme == "tcp" else OverTcpSession
        self.session = session(
            client,
            host=host,
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=self._came_at,
        )

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is under way."""
        return self.session.is_idle

    @property
    def last_asked(self) -> float:
        """When the client asked last, or NEVER."""
        return self.session.last_asked

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self.transport = cast("asyncio.Transport", transport)
        self._descriptor: int = transport.get_extra_info("socket").fileno()
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
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
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
        if self._timer is not None:
            self._timer.close()
            self._timer = None
        self._listener.closed(self, f"lost: {why(exc)}" if isinstance(exc, OSError) else self._reason)

    def receive(self, room: memoryview) -> int:
        """Put what has arrived into `room`; how many bytes those are. That the connection has ended, asyncio tells."""
        if self.transport.is_closing():
            return 0
        try:
            return os.readv(self._descriptor, [room])
        except OSError:
            return 0

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
        if self._timer is None:
            self._timer = LazyTimer(asyncio.get_running_loop(), self._proceed)
        self._timer.set(when)

    def release_after(self, seconds: float) -> None:
        """Hold the client back no longer once so many seconds have passed."""
        asyncio.get_running_loop().call_later(seconds, self.session.release)

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
        elif idle and self.is_idle and now - max(self.last_asked, self._came_at) >= idle:
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
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self._listener.failed(f"client {self.client}", error)
        self.abort("a defect in the gateway")
