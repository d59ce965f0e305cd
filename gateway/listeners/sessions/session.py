"""A client's connection as a state machine: bytes in, requests out, responses back, all of it bounded.

What all TCP clients have in common; their framings are in `mbap.py` and `over_tcp.py`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Final, Protocol

from gateway.errors import NotModbus, QueueFull
from gateway.listeners.settings import ListenSettings
from gateway.modbus.functions import only_reads
from gateway.request import Caller, Request, Target
from gateway.timing.measured import NEVER

#: How long a client may take to send one ADU, in seconds.
SENDING_DEADLINE: Final = 10.0
#: How long a client may leave its responses unread, in seconds.
TAKING_DEADLINE: Final = 30.0

#: How long a client is not read after the queue of a line refused one of its requests, in seconds: at first, and at
#: most. Each such refusal doubles it; any other response multiplies it by this.
SHORTEST_HOLD: Final = 0.002
LONGEST_HOLD: Final = 0.128
HOLD_RECOVERS: Final = 0.8

#: The states of a session: it goes down this list, and may skip some.
OPEN: Final = 0
#: The gateway takes no more requests; those in progress are answered.
FINISHING: Final = 1
#: The client has closed its side. It gets its responses, but its waiting writes are not sent.
HALF_CLOSED: Final = 2
#: Closed, or being closed.
GONE: Final = 3


class BackPressure:
    """Either the client does not read its responses, or the queue of a line has just refused one of its requests.

    Clients that repeat at once after a refusal would leave the lines no time. `blocked_at` is since when it does not
    read its responses, None while it does; `is_held` is whether it is held back after a refusal; `is_paused` is whether
    its connection has been told to receive nothing, for one of these or because it has enough requests in progress.
    """

    __slots__ = ("_hold", "blocked_at", "is_held", "is_paused")

    def __init__(self) -> None:
        self.blocked_at: float | None = None
        self.is_held = False
        self.is_paused = False
        self._hold = SHORTEST_HOLD

    @property
    def is_on(self) -> bool:
        """Whether the client is not to be read."""
        return self.is_held or self.blocked_at is not None

    def hold(self) -> float:
        """Hold the client back after a refusal; for how many seconds, 0.0 if it is already held back."""
        if self.is_held:
            return 0.0
        self.is_held = True
        seconds = self._hold
        self._hold = min(self._hold * 2, LONGEST_HOLD)
        return seconds

    def recover(self) -> None:
        """A request was accepted: the next hold is shorter."""
        self._hold = max(self._hold * HOLD_RECOVERS, SHORTEST_HOLD)


class Connection(Protocol):
    """What a session can do to its connection. Nothing here calls back into the session's requests and responses."""

    def time(self) -> float:
        """The time, for the last moment before a response leaves."""

    def receive(self, room: memoryview) -> int:
        """Copy what has arrived into `room`; the number of bytes, 0 if there are none."""

    def send(self, data: bytes) -> None:
        """Send `data`, or keep it until the client reads it."""

    def pause(self) -> None:
        """Receive nothing more until `resume`."""

    def resume(self) -> None:
        """Receive again, and call `proceed` soon for what has already been received."""

    def wake(self, when: float | None) -> None:
        """Call `proceed` at `when`, soon if that has passed; None cancels it, but not a call due to `resume`."""

    def release_after(self, seconds: float) -> None:
        """Call `release` after this many seconds."""

    def close(self) -> None:
        """Close once everything has been sent."""

    def reject(self, reason: str) -> None:
        """Close because of what the client did."""


class _Gone:
    """Replaces a connection that is closed, and does nothing."""

    def time(self) -> float:
        """See Connection."""
        return NEVER

    def receive(self, room: memoryview) -> int:  # noqa: ARG002 - nothing arrives
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

    At most `in_flight` requests are in progress; beyond that the gateway stops reading the client. It also stops for
    a moment when the queue of a line refuses a request (QueueFull).
    """

    __slots__ = (
        "_back_pressure", "_connection", "_in_flight", "_is_draining", "_life", "_limit", "_out",
        "_router", "_settings", "_whole_at", "asked", "caller", "last_asked",
    )  # fmt: skip

    def __init__(
        self,
        caller: Caller,
        *,
        router: Target,
        connection: Connection,
        settings: ListenSettings,
        now: float,
    ) -> None:
        """`router` takes the requests of `caller`."""
        self.caller = caller
        self.last_asked = NEVER
        #: How many requests it has sent.
        self.asked = 0
        self._life = OPEN
        self._router = router
        self._connection = connection
        self._settings = settings
        self._limit = settings.in_flight
        self._in_flight = 0
        #: Responses that have not been sent yet.
        self._out: list[bytes] = []
        self._is_draining = False
        self._back_pressure = BackPressure()
        #: When the last look found no incomplete ADU.
        self._whole_at = now

    @abstractmethod
    def room(self) -> memoryview:
        """The buffer for the next bytes from the client."""

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
    def _awaited_requests(self) -> Iterable[Request]:
        """The requests that were submitted and have no response yet."""

    @abstractmethod
    def _drain(self, now: float) -> None:
        """Submit the requests that have arrived, within the bounds. Raises NotModbus."""

    @property
    def gone(self) -> bool:
        """Whether the connection has ended, or is being closed."""
        return self._life == GONE

    @property
    def takes_responses(self) -> bool:
        """Whether neither end of the connection has been closed yet."""
        return self._life < HALF_CLOSED

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return self._in_flight == 0

    @property
    def in_progress(self) -> int:
        """The number of requests of the client that have no response yet."""
        return self._in_flight

    def proceed(self, now: float) -> None:
        """Submit the requests that have arrived, within the bounds; then send the responses that were ready at once."""
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
        """Whether a waiting request should still be sent.

        A client that has closed its side may be gone or may still read. It gets the responses to its reads; its waiting
        writes are not sent, and get 06.
        """
        return self._life != GONE and (self._life != HALF_CLOSED or only_reads(request.pdu))

    def block(self, now: float) -> None:
        """The client does not read its responses: read no more requests until `unblock`."""
        self._back_pressure.blocked_at = now

    def unblock(self) -> None:
        """The client reads its responses again."""
        self._back_pressure.blocked_at = None
        self._resume()
        self._close_when_done()

    def release(self) -> None:
        """Stop holding the client back after a refusal."""
        self._back_pressure.is_held = False
        self._resume()

    def end_of_input(self) -> None:
        """The client has closed its side; it still gets its responses, then the connection is closed."""
        if self._life != GONE:
            self._life = HALF_CLOSED
            self._give_up_all()
            self._close_when_done()

    def finish(self) -> None:
        """Take no more requests; the connection is closed once those in progress have been answered."""
        if self._life == OPEN:
            self._life = FINISHING
        self._limit = 0
        self._close_when_done()

    def find_fault(self, now: float) -> str:
        """Which rule the client breaks; empty if none.

        Called periodically. The request path does not note times for it: an ADU counts as begun at the last call that
        found none.
        """
        blocked_at = self._back_pressure.blocked_at
        if blocked_at is not None and now - blocked_at >= TAKING_DEADLINE:
            return f"took no responses for {TAKING_DEADLINE:g} s"
        waits_for_us = self._back_pressure.is_paused or blocked_at is not None
        self._whole_at = now if waits_for_us or not self.has_begun else max(self._whole_at, self.last_asked)
        if now - self._whole_at >= SENDING_DEADLINE:
            return f"sent no whole request within {SENDING_DEADLINE:g} s{self._hint}"
        return ""

    def closed(self) -> None:
        """The connection is closed; its responses are dropped. The session no longer refers to it.

        The connection refers to the session: as a cycle, both would never be freed after a reload (`service.garbage`).
        """
        self._life = GONE
        self._give_up_all()
        self._connection = _Gone()
        self._out.clear()

    def _give_up_all(self) -> None:
        for request in self._awaited_requests():
            request.give_up()

    @property
    def _hint(self) -> str:
        """The words to add if what it has sent looks like another framing."""
        return ""

    @property
    def _takes_more(self) -> bool:
        """Whether another request may be submitted."""
        return self._in_flight < self._limit and not self._back_pressure.is_on

    def _hold_back(self, request: Request) -> None:
        """Stop reading from the client for a moment if the queue refused this request."""
        if request.error is None or not isinstance(request.error, QueueFull):
            self._back_pressure.recover()
        elif seconds := self._back_pressure.hold():
            self._connection.release_after(seconds)

    def _pause(self) -> None:
        if not self._back_pressure.is_paused:
            self._back_pressure.is_paused = True
            self._connection.pause()

    def _resume(self) -> None:
        if self._back_pressure.is_paused and self._takes_more:
            self._back_pressure.is_paused = False
            self._connection.resume()

    def _flush(self) -> None:
        if self._out:
            data = self._out[0] if len(self._out) == 1 else b"".join(self._out)
            self._out.clear()
            self._connection.send(data)

    def _go_on(self) -> None:
        """A request is finished: send its response, resume reading, and close if it was the last.

        While requests are being submitted, `proceed` does that for all of them together.
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
        return f"<{type(self).__name__} {self.caller.client} in_flight={self._in_flight}>"
