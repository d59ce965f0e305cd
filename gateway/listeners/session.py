"""One client's connection as a machine: bytes in, requests out, responses back, with bounds on all of it.

What is the same for all clients of a TCP connection; what they speak is in `mbap.py` and `over_tcp.py`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from math import inf
from typing import Final, Literal, Protocol

from gateway.errors import NotModbus, QueueFull
from gateway.listeners.back_pressure import BackPressure
from gateway.listeners.failures import OnFailure
from gateway.modbus.functions import only_reads
from gateway.request import Request, Target

#: How long a client may take to send one ADU, in seconds, however many bytes it sends meanwhile.
SENDING_DEADLINE: Final = 10.0
#: How long a client may leave its responses untaken, in seconds.
TAKING_DEADLINE: Final = 30.0

#: Why a client is sent away before a byte of it is read; for other reasons see `admission`.
NOT_MEANT: Final = "it came to another address than the listener's, through a socket of systemd that takes more"
#: When a client asked that never did.
NEVER: Final = -inf

#: The life of a session: it goes down this list, and may leave steps out.
OPEN: Final = 0
#: The gateway takes no more requests; those that were taken are answered.
FINISHING: Final = 1
#: The client sends no more. It gets its responses, but waits for no write.
HALF_CLOSED: Final = 2
#: Closed, or being closed.
GONE: Final = 3


@dataclass(frozen=True, slots=True)
class ListenSettings:
    """One address where clients connect. Times in seconds; `idle` 0 keeps connections for ever.

    Of the places of `clients`, so many as `reserve` are only for addresses that rows of the rights name.
    `scheme` is what they speak: `tcp`, `rtu+tcp`, `ascii+tcp` or `udp`.
    `ipv6_only` is for the host `::`: it leaves IPv4 clients to another listener on the same port.
    `on_failure` is what a client gets when nobody has answered. `line` is the one line that it is for, if it is.
    `shares_port`: another listener has this port at another address.
    """

    name: str
    host: str
    port: int
    clients: int = 32
    idle: float = 600.0
    in_flight: int = 16
    unit0: Literal["refuse", "broadcast"] | int = "refuse"
    source: str = field(default="", compare=False)
    scheme: str = "tcp"
    ipv6_only: bool = False
    on_failure: OnFailure = "exception"
    line: str = ""
    shares_port: bool = field(default=False, compare=False)
    reserve: int = 0


@dataclass(slots=True)
class Counts:
    """Clients that have connected, and clients that were sent away, when they connected or later."""

    accepted: int = 0
    rejected: int = 0


class Connection(Protocol):
    """What a session can do to its connection. Nothing here calls back into the session's requests and responses."""

    def receive(self, room: memoryview) -> int:
        """Put what has arrived into `room`; how many bytes those are, 0 when there are none."""

    def send(self, data: bytes) -> None:
        """Send `data`, or keep it until the client takes it."""

    def pause(self) -> None:
        """Receive nothing more until `resume`: the client has to wait."""

    def resume(self) -> None:
        """Receive again, and call `proceed` soon for what has already been received."""

    def wake(self, when: float | None) -> None:
        """Call `proceed` at `when`, soon if that has passed; None: no more, unless `resume` wants it."""

    def release_after(self, seconds: float) -> None:
        """Call `release` once so many seconds have passed."""

    def close(self) -> None:
        """Close once everything sent has left."""

    def reject(self, reason: str) -> None:
        """Close because of what the client did."""


class _Gone:
    """In place of a connection that has gone: it takes everything and does nothing."""

    def receive(self, room: memoryview) -> int:  # noqa: ARG002 - nothing arrives any more
        """See Connection."""
        return 0

    def send(self, data: bytes) -> None:
        """See Connection."""

    def pause(self) -> None:
        """See Connection."""

    def resume(self) -> None:
        """See Connection."""

    def wake(self, when: float | None) -> None:
        """See Connection."""

    def release_after(self, seconds: float) -> None:
        """See Connection."""

    def close(self) -> None:
        """See Connection."""

    def reject(self, reason: str) -> None:
        """See Connection."""


class Session(ABC):
    """A client on a TCP connection: the Origin of its requests.

    At most `in_flight` requests are under way; beyond that the gateway stops reading from the client. So it does for a
    moment when a line has no room for a request (QueueFull).
    """

    __slots__ = (
        "_back_pressure", "_connection", "_in_flight", "_is_draining", "_is_paused", "_life", "_limit", "_out",
        "_router", "_settings", "_whole_at", "client", "host", "last_asked",
    )  # fmt: skip

    def __init__(
        self,
        client: str,
        *,
        host: str,
        router: Target,
        connection: Connection,
        settings: ListenSettings,
        now: float,
    ) -> None:
        """`client` names the peer in events, `host` is its address; `router` takes its requests."""
        self.client = client
        self.host = host
        self.last_asked = NEVER
        self._life = OPEN
        self._router = router
        self._connection = connection
        self._settings = settings
        self._limit = settings.in_flight
        self._in_flight = 0
        #: Responses that have not been sent yet.
        self._out: list[bytes] = []
        self._is_draining = False
        self._is_paused = False
        self._back_pressure = BackPressure()
        #: When there was last no half of an ADU, as far as is known.
        self._whole_at = now

    @abstractmethod
    def room(self) -> memoryview:
        """Where the next bytes from the client go."""

    @abstractmethod
    def received(self, count: int, now: float) -> None:
        """`count` bytes have arrived in `room()`."""

    @abstractmethod
    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests."""

    @property
    @abstractmethod
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""

    @abstractmethod
    def _drain(self, now: float) -> None:
        """Submit the requests that have arrived, as far as the bounds allow. Raises NotModbus."""

    @property
    def gone(self) -> bool:
        """Whether the connection has ended, or is being closed."""
        return self._life == GONE

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is under way."""
        return self._in_flight == 0

    def proceed(self, now: float) -> None:
        """Submit the requests that have arrived, as far as the bounds allow; then send what was answered at once."""
        self._is_draining = True
        try:
            self._drain(now)
        except NotModbus as error:
            self._flush()
            self._life = GONE
            self._connection.reject(str(error))
            return
        finally:
            self._is_draining = False
        self._flush()
        self._close_when_done()

    def wants(self, request: Request) -> bool:
        """Whether a request that still waits should be sent.

        A client that sends no more may have left or may still read: it gets the answers to what it reads, but a write
        that nobody may be waiting for is not sent any more. In case somebody is, it is answered 06.
        """
        return self._life != GONE and (self._life != HALF_CLOSED or only_reads(request.pdu))

    def block(self, now: float) -> None:
        """The client does not take its responses: read no more requests until `unblock`."""
        self._back_pressure.blocked_at = now

    def unblock(self) -> None:
        """The client takes its responses again."""
        self._back_pressure.blocked_at = None
        self._resume()
        self._close_when_done()

    def release(self) -> None:
        """The client was held back for long enough after a refusal."""
        self._back_pressure.is_held = False
        self._resume()

    def end_of_input(self) -> None:
        """The client sends no more; it still gets its responses, then the connection is closed."""
        if self._life != GONE:
            self._life = HALF_CLOSED
            self._close_when_done()

    def finish(self) -> None:
        """Take no more requests; the connection is closed once those under way have been answered."""
        if self._life == OPEN:
            self._life = FINISHING
        self._limit = 0
        self._close_when_done()

    def complaint(self, now: float) -> str:
        """Why the client cannot be kept any longer; empty when it can.

        To be asked every now and then: the request path keeps no time for it, so an ADU counts as begun when the last
        call without one was.
        """
        blocked_at = self._back_pressure.blocked_at
        if blocked_at is not None and now - blocked_at >= TAKING_DEADLINE:
            return f"took no responses for {TAKING_DEADLINE:g} s"
        waits_for_us = self._is_paused or blocked_at is not None
        self._whole_at = now if waits_for_us or not self.has_begun else max(self._whole_at, self.last_asked)
        if now - self._whole_at >= SENDING_DEADLINE:
            return f"sent no whole request within {SENDING_DEADLINE:g} s"
        return ""

    def closed(self) -> None:
        """The connection has gone, and with it the wish for any response. Nothing here holds it any more.

        It holds the session: two that hold each other at a reload would stay for ever (`service.garbage`).
        """
        self._life = GONE
        self._connection = _Gone()
        self._out.clear()

    @property
    def _takes_more(self) -> bool:
        """Whether another request may be submitted."""
        return self._in_flight < self._limit and not self._back_pressure.is_on

    def _hold_back(self, request: Request) -> None:
        """Take no more from the client for a moment, if there was no room for this request of its."""
        if not isinstance(request.error, QueueFull):
            self._back_pressure.recover()
        elif seconds := self._back_pressure.hold():
            self._connection.release_after(seconds)

    def _pause(self) -> None:
        if not self._is_paused:
            self._is_paused = True
            self._connection.pause()

    def _resume(self) -> None:
        if self._is_paused and self._takes_more:
            self._is_paused = False
            self._connection.resume()

    def _flush(self) -> None:
        if self._out:
            data = self._out[0] if len(self._out) == 1 else b"".join(self._out)
            self._out.clear()
            self._connection.send(data)

    def _go_on(self) -> None:
        """A request has been finished: send its response, read again if that has stopped, and close if it was the last.

        While what has arrived is being submitted, `proceed` does that for all of them together.
        """
        if not self._is_draining:
            self._flush()
            self._resume()
            self._close_when_done()

    def _close_when_done(self) -> None:
        if OPEN != self._life != GONE and self._in_flight == 0 and self._back_pressure.blocked_at is None:
            self._life = GONE
            self._connection.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.client} in_flight={self._in_flight}>"
