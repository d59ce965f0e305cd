"""Connects a session to its TCP connection and to asyncio."""

import asyncio
from collections.abc import Callable
from functools import partial
from math import inf
from time import time as wall_clock
from typing import Final, Protocol

from gateway.clock.exact_loop import ExactLoop
from gateway.clock.lazy_timer import LazyTimer
from gateway.listeners.holds import Holds
from gateway.listeners.sessions.mbap import MbapSession
from gateway.listeners.sessions.over_tcp import OverTcpSession
from gateway.listeners.sessions.session import Connection, Session
from gateway.listeners.settings import ListenSettings
from gateway.listeners.sockets import explain
from gateway.modbus.codes import MAX_TCP_ADU
from gateway.modbus.mbap import MOST_AT_ONCE
from gateway.request import Caller, Target

#: The most bytes kept for a client that does not read its responses; more with a high `in_flight`.
UNSENT_BYTES: Final = 64 * 1024
#: The reason for closing a client in the middle of its work.
EXPIRED: Final = "its certificate has expired"
_NO_ROOM: Final = memoryview(bytearray())


def most_answered(in_flight: int) -> int:
    """Return the most bytes of responses after reading has stopped: to requests in progress and in the buffer."""
    return (in_flight + MOST_AT_ONCE) * MAX_TCP_ADU


def most_unsent(in_flight: int) -> int:
    """Return the most bytes kept for a client that does not read: UNSENT_BYTES, or all responses it may request."""
    return max(UNSENT_BYTES, most_answered(in_flight))


class Stream(Protocol):
    """The transport of a connection: `TcpStream`, or one that encrypts."""

    def is_closing(self) -> bool:
        """Tell whether it is closed, or being closed."""

    def set_write_buffer_limits(self, high: int) -> None:
        """Call `pause_writing` when more than `high` bytes wait for the client."""

    def pause_reading(self) -> None:
        """Receive nothing until `resume_reading`."""

    def resume_reading(self) -> None:
        """Receive again."""

    def receive(self, room: memoryview) -> int:
        """Copy received bytes into `room`. Return their number; 0 if they are delivered anyway."""

    def write(self, data: bytes) -> None:
        """Send `data`, unless the connection is closed."""

    def close(self) -> None:
        """Close once everything is sent."""

    def abort(self) -> None:
        """Close now."""


class ConnectionOwner(Protocol):
    """The listener that accepted a connection."""

    settings: ListenSettings
    holds: Holds

    def connected(self, connection: "TcpConnection") -> None:
        """Count a new client."""

    def closing(self, connection: "TcpConnection") -> None:
        """Stop counting a connection for `clients`: it is being closed."""

    def closed(self, connection: "TcpConnection", reason: str) -> None:
        """Forget a connection that has ended."""

    def rejected(self, client: str, reason: str) -> None:
        """Count a rejected client, and report the reason."""

    def left_early(self, host: str, waited: float) -> None:
        """Count a client that closed its side `waited` seconds after its last request, without a response."""

    def failed(self, part: str, error: Exception) -> None:
        """Report an unexpected error caught at the error boundary of a connection."""


class TcpConnection(Connection):
    """The driver of one connection, the user of its stream. An unexpected error ends only this connection."""

    stream: Stream
    session: Session
    #: The role in the client's certificate, None without one.
    role: str | None = None

    def __init__(
        self,
        listener: ConnectionOwner,
        caller: Caller,
        time: Callable[[], float],
        router: Target,
    ) -> None:
        """Submit the requests of `caller` to `router`."""
        self.caller = caller
        self._listener = listener
        self._time = time
        self._came_at = time()
        #: The reason for its end, for the event.
        self._reason = "the client closed it"
        self._timer: LazyTimer | None = None
        session = MbapSession if listener.settings.scheme in ("tcp", "tls") else OverTcpSession
        self.session = session(
            caller,
            router=router,
            connection=self,
            settings=listener.settings,
            now=self._came_at,
        )

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return self.session.is_idle

    @property
    def last_asked(self) -> float:
        """The time of the client's last request, or NEVER."""
        return self.session.last_asked

    @property
    def asked(self) -> int:
        """Number of the client's requests."""
        return self.session.asked

    @property
    def in_progress(self) -> int:
        """Number of requests without a response."""
        return self.session.in_progress

    def connection_made(self, stream: Stream) -> None:
        """Begin: a client has connected."""
        self.stream = stream
        self._write = stream.write
        in_flight = self._listener.settings.in_flight
        stream.set_write_buffer_limits(most_unsent(in_flight) - most_answered(in_flight))
        self._listener.connected(self)

    def get_buffer(self) -> memoryview:
        """Return the buffer to receive into; empty if there is no room, or the connection has failed."""
        try:
            return self.session.room()
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
            self._failed(error)
            return _NO_ROOM

    def buffer_updated(self, nbytes: int) -> None:
        """Process received bytes."""
        try:
            self.session.received(nbytes, self._time())
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
            self._failed(error)

    def eof_received(self) -> bool:
        """Note that the client has closed its side; the connection stays until the responses are sent."""
        self._run(self._end_input)
        return True

    def pause_writing(self) -> None:
        """Stop processing requests: the client does not read its responses."""
        self._run(partial(self.session.block, self.time()))

    def resume_writing(self) -> None:
        """Process requests again: the client reads its responses."""
        self._run(self.session.unblock)

    def connection_lost(self, exc: Exception | None) -> None:
        """Clean up: the connection has ended."""
        try:
            if exc is not None:
                self._leaves()
            self.session.closed()
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
            self._listener.failed(f"client {self.caller.client}", error)
        if self._timer is not None:
            self._timer.close()
            self._timer = None
        self._listener.closed(self, f"lost: {explain(exc)}" if isinstance(exc, OSError) else self._reason)

    def time(self) -> float:
        """Return the time of the loop's clock."""
        return self._time()

    def receive(self, room: memoryview) -> int:
        """Receive into `room` what has arrived; see Stream."""
        return self.stream.receive(room)

    def send(self, data: bytes) -> None:
        """Send a response, unless the connection is closed."""
        self._write(data)

    def pause(self) -> None:
        """Receive nothing more until `resume`."""
        self.stream.pause_reading()

    def resume(self) -> None:
        """Receive again, and process bytes that have already arrived."""
        # scheduled first: the session makes room for bytes that a transport already holds
        loop = asyncio.get_running_loop()
        if isinstance(loop, ExactLoop):
            loop.wake_at(self.time(), self._proceed)
        else:
            loop.call_soon(self._proceed)
        self.stream.resume_reading()

    def wake(self, when: float | None) -> None:
        """Process bytes that have already arrived at `when`; None cancels that."""
        if self._timer is None:
            self._timer = LazyTimer(asyncio.get_running_loop(), self._proceed)
        self._timer.set(when)

    def release_after(self, seconds: float) -> None:
        """Stop holding the client back after this many seconds."""
        self._listener.holds.add(seconds, self._release)

    def close(self, reason: str = "") -> None:
        """Close once queued bytes are sent, or after the deadline for that. Awaited responses are dropped."""
        self._end(reason)
        self.stream.close()

    def abort(self, reason: str = "") -> None:
        """Close now, and drop queued bytes."""
        self._end(reason)
        self.stream.abort()

    def reject(self, reason: str) -> None:
        """Close because of the client's behaviour, or to accept another client."""
        self._listener.rejected(self.caller.client, reason)
        self.close(reason)

    def look(self) -> None:
        """Read what has arrived, if its time of arrival matters."""
        if isinstance(self.session, OverTcpSession):
            self._run(partial(self.session.look, self.time()))

    def check_client(self, now: float, idle: float) -> None:
        """Close if the client breaks a rule, or has sent no request for `idle` seconds."""
        complaint = self.session.find_fault(now)
        if complaint:
            self.reject(complaint)
        elif idle and self.is_idle and now - max(self.last_asked, self._came_at) >= idle:
            self.close("idle")

    def finish(self, reason: str = "the gateway is stopping") -> None:
        """Accept no more requests; close when those in progress are answered."""
        self._reason = reason
        self.session.finish()

    def _end_input(self) -> None:
        self._leaves()
        self.session.end_of_input()

    def _leaves(self) -> None:
        """Report to the listener if a response is missing when the client closes its side."""
        session = self.session
        if not session.is_idle and session.takes_responses:
            self._listener.left_early(self.caller.host, self.time() - session.last_asked)

    def _end(self, reason: str) -> None:
        self._reason = reason or self._reason
        self.session.closed()
        self._listener.closing(self)

    def _release(self) -> bool:
        """Stop holding the client back. Return False if it is gone."""
        if self.session.gone:
            return False
        self._run(self.session.release)
        return True

    def _proceed(self) -> None:
        if not self.session.gone:
            self._run(partial(self.session.proceed, self.time()))

    def _run(self, step: Callable[[], None]) -> None:
        try:
            step()
        except Exception as error:  # noqa: BLE001 - the error boundary of a connection
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self._listener.failed(f"client {self.caller.client}", error)
        self.abort("a defect in the gateway")


class SecuredConnection(TcpConnection):
    """A connection whose stream encrypts."""

    #: The end of the validity of the client's certificate, in seconds since 1970.
    valid_until = inf

    def check_client(self, now: float, idle: float) -> None:
        """Check the client, and close after its requests in progress once its certificate has expired."""
        if wall_clock() > self.valid_until and not self.stream.is_closing():
            self.finish(EXPIRED)
        super().check_client(now, idle)
