"""A client's connection as a state machine: bytes in, requests out, responses back, all of it bounded.

`Session` is common to all TCP clients; `mbap.py` and `over_tcp.py` add the framings.
"""

from abc import abstractmethod
from collections.abc import Iterable
from typing import Final

from gateway.compiler import mypyc_attr
from gateway.errors import NotModbus, QueueFull
from gateway.listeners.settings import ListenSettings
from gateway.modbus.functions import only_reads
from gateway.request import Caller, Origin, Request, Target
from gateway.timing.measured import NEVER

#: How long a client may take to send one ADU, in seconds.
SENDING_DEADLINE: Final = 10.0
#: How long a client may leave its responses unread, in seconds.
TAKING_DEADLINE: Final = 30.0

#: How long a client is not read after the queue of a line refused one of its requests, in seconds: at first, and at
#: most. Each such refusal doubles it; any other response multiplies it by HOLD_RECOVERS.
SHORTEST_HOLD: Final = 0.002
LONGEST_HOLD: Final = 0.128
HOLD_RECOVERS: Final = 0.8

#: The states of a session, in this order; some may be skipped.
OPEN: Final = 0
#: The gateway takes no more requests; those in progress are answered.
FINISHING: Final = 1
#: The client has closed its side. It gets its responses, but its waiting writes are not sent.
HALF_CLOSED: Final = 2
#: Closed, or being closed.
GONE: Final = 3


class BackPressure:
    """The reasons not to read a client: it does not read its responses, or a queue has just refused its request.

    Clients that repeat at once after a refusal would leave the lines no time.
    """

    __slots__ = ("_hold", "blocked_at", "is_held", "is_paused")

    def __init__(self) -> None:
        #: Since when the client does not read its responses; None while it does.
        self.blocked_at: float | None = None
        #: Whether the client is held back after a refusal.
        self.is_held = False
        #: Whether the connection receives nothing: for one of these reasons, or because enough requests are in
        #: progress.
        self.is_paused = False
        #: The seconds for which the next refusal holds it back.
        self._hold = SHORTEST_HOLD

    @property
    def is_on(self) -> bool:
        """Whether the client must not be read."""
        return self.is_held or self.blocked_at is not None

    def hold(self) -> float:
        """Hold the client back after a refusal. Return for how many seconds; 0.0 if it is already held back."""
        if self.is_held:
            return 0.0
        self.is_held = True
        seconds = self._hold
        self._hold = min(self._hold * 2, LONGEST_HOLD)
        return seconds

    def recover(self) -> None:
        """Shorten the next hold: a request was accepted."""
        self._hold = max(self._hold * HOLD_RECOVERS, SHORTEST_HOLD)


@mypyc_attr(allow_interpreted_subclasses=True)
class Connection:
    """The operations of a session on its connection. None of them calls back into its requests and responses."""

    __slots__ = ()

    @abstractmethod
    def time(self) -> float:
        """Return the current time, for decisions right before a response is sent."""

    @abstractmethod
    def receive(self, room: memoryview) -> int:
        """Copy received bytes into `room`. Return their number; 0 if there are none."""

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send `data`, or keep it until the client reads it."""

    @abstractmethod
    def pause(self) -> None:
        """Receive nothing more until `resume`."""

    @abstractmethod
    def resume(self) -> None:
        """Receive again, and call `proceed` soon for bytes that have already been received."""

    @abstractmethod
    def wake(self, when: float | None) -> None:
        """Call `proceed` at `when`, soon if that has passed; None cancels it, but not a call due to `resume`."""

    @abstractmethod
    def release_after(self, seconds: float) -> None:
        """Call `release` after this many seconds, or later if many are held back."""

    @abstractmethod
    def close(self) -> None:
        """Close once everything is sent."""

    @abstractmethod
    def reject(self, reason: str) -> None:
        """Close because of the client's behaviour."""


class _Gone(Connection):
    """Replaces a closed connection, and does nothing."""

    def time(self) -> float:
        """Return NEVER."""
        return NEVER

    def receive(self, room: memoryview) -> int:  # noqa: ARG002 - nothing arrives
        """Return 0: nothing arrives."""
        return 0

    def send(self, data: bytes) -> None:
        """Drop `data`."""

    def pause(self) -> None:
        """Do nothing."""

    def resume(self) -> None:
        """Do nothing."""

    def wake(self, when: float | None) -> None:
        """Do nothing."""

    def release_after(self, seconds: float) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def reject(self, reason: str) -> None:
        """Do nothing."""


class Session(Origin):
    """A client on a TCP connection: the Origin of its requests.

    At most `in_flight` requests are in progress; beyond that the gateway stops reading the client. It also stops for a
    moment when the queue of a line refuses a request (QueueFull).
    """

    __slots__ = (
        "_back_pressure", "_connection", "_is_draining", "_life", "_limit", "_out",
        "_router", "_settings", "_whole_at", "asked", "caller", "in_progress", "last_asked",
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
        """Submit the requests of `caller` to `router`."""
        self.caller = caller
        #: When the client last sent a request.
        self.last_asked = NEVER
        #: The number of its requests.
        self.asked = 0
        self._life = OPEN
        self._router = router
        self._connection = connection
        self._settings = settings
        #: The most requests in progress; 0 while no more are taken.
        self._limit = settings.in_flight
        #: The number of its requests without a response.
        self.in_progress = 0
        #: Responses that are not sent yet.
        self._out: list[bytes] = []
        #: Whether `proceed` is submitting requests: it sends the responses to all of them together.
        self._is_draining = False
        self._back_pressure = BackPressure()
        #: When the last look found no incomplete ADU.
        self._whole_at = now

    @abstractmethod
    def room(self) -> memoryview:
        """Return the buffer for the next bytes from the client."""

    @abstractmethod
    def received(self, count: int, now: float) -> None:
        """Process `count` bytes that were received into `room()`."""

    @abstractmethod
    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests."""

    @property
    @abstractmethod
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""

    @abstractmethod
    def _awaited_requests(self) -> Iterable[Request]:
        """Return the submitted requests without a response."""

    @abstractmethod
    def _drain(self, now: float) -> None:
        """Submit received requests, within the bounds. Raises NotModbus."""

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
        return self.in_progress == 0

    def proceed(self, now: float) -> None:
        """Submit received requests, within the bounds; then send the responses that were ready at once."""
        self._is_draining = True
        try:
            self._drain(now)
        except NotModbus as error:
            self._flush_drained()
            self._life = GONE
            self._connection.reject(str(error))
            return
        finally:
            self._is_draining = False
        self._flush_drained()
        self._close_when_done()

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting request should still be sent.

        A client that has closed its side may be gone or may still read. It gets the responses to its reads; its waiting
        writes are not sent, and get 06.
        """
        return self._life != GONE and (self._life != HALF_CLOSED or only_reads(request.pdu))

    def block(self, now: float) -> None:
        """Stop reading requests until `unblock`: the client does not read its responses."""
        self._back_pressure.blocked_at = now

    def unblock(self) -> None:
        """Read requests again: the client reads its responses."""
        self._back_pressure.blocked_at = None
        self._resume()
        self._close_when_done()

    def release(self) -> None:
        """Stop holding the client back after a refusal."""
        self._back_pressure.is_held = False
        self._resume()

    def end_of_input(self) -> None:
        """Note that the client has closed its side: close once it has its responses."""
        if self._life != GONE:
            self._life = HALF_CLOSED
            self._give_up_all()
            self._close_when_done()

    def finish(self) -> None:
        """Accept no more requests, and close once those in progress are answered."""
        if self._life == OPEN:
            self._life = FINISHING
        self._limit = 0
        self._close_when_done()

    def find_fault(self, now: float) -> str:
        """Return the rule that the client breaks, in words; empty if none. Call it periodically.

        The request path does not note times for it: an ADU counts as begun at the last call that found none.
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
        """Drop the responses, and the reference to the closed connection.

        The connection refers to the session: as a cycle, both would never be freed after a reload (`runtime.garbage`).
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
        """The addition to a message if the client's bytes look like another framing."""
        return ""

    @property
    def _takes_more(self) -> bool:
        """Whether another request may be submitted."""
        return self.in_progress < self._limit and not self._back_pressure.is_on

    def _hold_back(self, request: Request) -> None:
        """Stop reading from the client for a moment if a queue has refused this request."""
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

    def _flush_drained(self) -> None:
        """Send the responses that were ready at once."""
        self._flush()

    def _flush(self) -> None:
        if self._out:
            data = self._out[0] if len(self._out) == 1 else b"".join(self._out)
            self._out.clear()
            self._connection.send(data)

    def _go_on(self) -> None:
        """Send the response to a finished request, resume reading, and close if it was the last.

        While requests are being submitted, `proceed` does that for all of them together.
        """
        if not self._is_draining:
            self._flush()
            self._resume()
            self._close_when_done()

    def _close_when_done(self) -> None:
        if OPEN != self._life != GONE and self.in_progress == 0 and self._back_pressure.blocked_at is None:
            self._life = GONE
            self._connection.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.caller.client} in_flight={self.in_progress}>"
