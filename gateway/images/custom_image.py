"""A unit made in Python as a target of requests: one after the other, each within its time.

A request is one or two calls of the unit, `read` and `write`. Those that come meanwhile wait, at most MOST_WAITING,
each for the `timeout` of the unit: then it gets 06, as nothing was done for it. A request whose calls are not over
`timeout` seconds after the first began gets 0B, and they are cancelled. A call may go on nevertheless: until it ends,
no other begins.

A unit that has not answered in time three times in a row rests, as a device does (`lines/breaker.py`). So does one
where requests wait for a call that does not end.
"""

from collections import deque
from typing import Final, Protocol

from gateway.errors import (
    DeviceFailure,
    LineDown,
    LineLost,
    QueueFull,
    RequestError,
    ResponseTimeout,
    UnitResting,
    Unwanted,
    WaitedTooLong,
)
from gateway.events import Emit, RequestTimeout, UnitRecovered, discard_event
from gateway.events import UnitResting as RestBegins
from gateway.images.custom_calls import Call, Steps, steps_of
from gateway.images.image import Image, ImageSettings
from gateway.images.services import Diagnostics
from gateway.images.tables import make_tables
from gateway.lines.breaker import Breaker
from gateway.modbus.pdu import RequestPdu, Span
from gateway.profiles.profile import covers
from gateway.request import Request
from gateway.trace.ring import Ring

#: The most requests that wait.
MOST_WAITING: Final = 64
#: Its product name in function 43.
PRODUCT: Final = "custom unit"

#: What a client that waits or has left gets, and what is told otherwise.
_UNTOLD: Final = (WaitedTooLong, Unwanted, UnitResting, ResponseTimeout, LineLost, LineDown)


class Calls(Protocol):
    """Carries out the calls of a unit, one at a time. `CustomImage.ended` is told of each, after `begin` returns."""

    def begin(self, call: Call) -> None:
        """Carry out a call."""

    def cancel(self) -> bool:
        """Cancel the call that is carried out. Return False if it had not begun: then it never does, nor is it told."""

    def wake_at(self, deadline: float | None) -> None:
        """Have `CustomImage.tick` called at this time, in place of the time that was said before; None for never."""


class _Turn:
    """A request that waits, or is carried out from its first call on."""

    __slots__ = ("asked", "came_at", "expires_at", "has_effect", "in_one_turn", "is_answered", "request", "steps")

    def __init__(
        self, request: Request, asked: RequestPdu, in_one_turn: int, came_at: float, expires_at: float
    ) -> None:
        self.request = request
        self.asked = asked
        self.in_one_turn = in_one_turn
        self.came_at = came_at
        #: When it has waited, or its calls have taken, too long.
        self.expires_at = expires_at
        self.steps: Steps | None = None
        #: Whether a call is over: so the unit may have acted.
        self.has_effect = False
        #: Whether its client has its answer, while a call goes on.
        self.is_answered = False


class CustomImage(Image):
    """A Target whose values are those that a CustomUnit returns; `calls` carries out its calls."""

    def __init__(
        self, settings: ImageSettings, calls: Calls, emit: Emit = discard_event, ring: Ring | None = None
    ) -> None:
        super().__init__(settings, emit, ring, Diagnostics(), PRODUCT, make_tables({}, {}))
        self.breaker = Breaker()
        self._calls = calls
        self._waiting: deque[_Turn] = deque()
        self._present: _Turn | None = None
        #: Since when a call goes on that was cancelled.
        self._hangs_since: float | None = None
        self._is_going_on = False
        self._is_closed = False

    def submit(self, request: Request, now: float) -> None:
        """Refuse `request` at once, or carry it out when those before it are over."""
        self._begin(request)
        in_one_turn = request.in_one_turn
        try:
            asked = self._check(request)
            if self._is_closed:
                raise LineDown(f"{self.name} has ended")
            if len(self._waiting) >= MOST_WAITING:
                self._drop_unwanted(now)
            if len(self._waiting) >= MOST_WAITING:
                raise QueueFull(f"{MOST_WAITING} requests wait for it already")
        except RequestError as error:
            self._finish(request, error, now)
            return
        self._waiting.append(_Turn(request, asked, in_one_turn, now, now + self.settings.timeout))
        self._go_on(now)

    def ended(self, outcome: bytes | RequestError, now: float) -> None:
        """Go on after a call, with the items that it has read, or with the error for its client."""
        turn = self._present
        if turn is None:
            return
        is_written = turn.has_effect and turn.asked.read is not None  # function 23
        turn.has_effect = True
        if is_written and not isinstance(outcome, bytes):
            outcome = DeviceFailure(f"it was written, and not read: {outcome}")  # 02 or 06 would deny that
        if turn.is_answered:
            self._present, self._hangs_since = None, None
        elif isinstance(outcome, bytes):
            self._advance(turn, outcome, now)
        else:
            self._answer(turn, outcome, now)
        self._go_on(now)

    def tick(self, now: float) -> None:
        """Fail what has taken, or waited, too long."""
        turn = self._present
        if turn is not None and not turn.is_answered and turn.expires_at <= now:
            self._time_out(turn, now)
        waiting = self._waiting
        while waiting and waiting[0].expires_at <= now:
            late = waiting.popleft()
            if self._hangs_since is not None and late.came_at >= self._hangs_since:
                self._record_failure(now)
            self._finish(late.request, self._waited_too_long(), now)
        self._go_on(now)

    def abandon(self, now: float) -> None:
        """Fail the present request, whose processing met a defect."""
        turn, self._present, self._hangs_since = self._present, None, None
        if turn is not None and not turn.request.is_over:
            turn.request.fail(DeviceFailure())
        self._go_on(now)

    def close(self, now: float) -> None:
        """Cancel the present call, and fail all requests."""
        self._is_closed = True
        turn, waiting = self._present, list(self._waiting)
        self._waiting.clear()
        if turn is not None and not turn.is_answered:
            has_ended = f"{self.name} has ended"
            error = LineLost(has_ended) if self._cancel(turn, now) else LineDown(has_ended)
            self._finish(turn.request, error, now)
        for each in waiting:
            self._finish(each.request, LineDown(f"{self.name} has ended"), now)
        self._calls.wake_at(None)

    def _go_on(self, now: float) -> None:
        """Begin with the next request if the last one is over. Requests that are answered may bring the next ones."""
        if self._is_going_on:
            return
        self._is_going_on = True
        try:
            while self._present is None and self._waiting:
                self._take(self._waiting.popleft(), now)
        finally:
            self._is_going_on = False
        self._calls.wake_at(self._deadline())

    def _take(self, turn: _Turn, now: float) -> None:
        """Begin with a request, or answer it."""
        request = turn.request
        if not request.origin.wants(request):
            self._finish(request, Unwanted("its client has left"), now)
        elif turn.expires_at <= now:
            self._finish(request, self._waited_too_long(), now)
        elif turn.asked.function in self._services:
            self._finish(request, self._served(turn.asked), now)
        elif self.breaker.is_resting(now):
            self._finish(request, UnitResting(f"{self.name} rests: {self.breaker.failures} failures in a row"), now)
        else:
            self._present = turn
            turn.steps = steps_of(turn.asked, self._profile, turn.in_one_turn)
            turn.expires_at = now + self.settings.timeout
            self._calls.begin(next(turn.steps))

    def _served(self, asked: RequestPdu) -> bytes | RequestError:
        try:
            return self._perform(asked)
        except RequestError as error:
            return error

    def _advance(self, turn: _Turn, items: bytes, now: float) -> None:
        """Begin the next call, or answer."""
        try:
            assert turn.steps is not None  # noqa: S101 - since the first call
            call = turn.steps.send(items)
        except StopIteration as over:
            self._answer(turn, over.value, now)
        except RequestError as error:  # a guard
            self._answer(turn, error, now)
        else:
            self._calls.begin(call)

    def _answer(self, turn: _Turn, outcome: bytes | RequestError, now: float) -> None:
        """Answer a request whose calls are over in time."""
        self._present = None
        if self.breaker.record_success():
            self._emit(UnitRecovered("", self.settings.unit, self.name))
        self._finish(turn.request, outcome, now)

    def _time_out(self, turn: _Turn, now: float) -> None:
        """Answer a request whose calls have taken too long."""
        settings, request = self.settings, turn.request
        error: RequestError = WaitedTooLong(f"{self.name} could not begin within {settings.timeout:g} s")
        if self._cancel(turn, now):
            error = ResponseTimeout(f"{self.name} did not answer within {settings.timeout:g} s")
            elapsed, limit = round((now - request.received_at) * 1000, 1), round(settings.timeout * 1000, 1)
            self._emit(RequestTimeout("", settings.unit, self.name, request.pdu[0], elapsed, limit, settings.source))
        self._record_failure(now)
        self._finish(request, error, now)

    def _cancel(self, turn: _Turn, now: float) -> bool:
        """Cancel the calls of a request, which gets its answer now. Return whether the unit may have acted."""
        goes_on = self._calls.cancel()
        if goes_on:
            turn.is_answered, self._hangs_since = True, now
        else:
            self._present = None
        return goes_on or turn.has_effect

    def _record_failure(self, now: float) -> None:
        if not self.breaker.is_resting(now) and self.breaker.record_failure(self.settings.timeout, now):
            rest = round(self.breaker.rest_left(now), 1)
            self._emit(RestBegins("", self.settings.unit, self.name, rest, self.settings.source))

    def _finish(self, request: Request, outcome: bytes | RequestError, now: float) -> None:
        try:
            super()._finish(request, outcome, now)
        except BaseException:
            if not request.is_over:
                request.fail(DeviceFailure())
            raise

    def _drop_unwanted(self, now: float) -> None:
        unwanted = [turn for turn in self._waiting if not turn.request.origin.wants(turn.request)]
        for turn in unwanted:
            self._waiting.remove(turn)
        for turn in unwanted:
            self._finish(turn.request, Unwanted("its client has left"), now)

    def _waited_too_long(self) -> WaitedTooLong:
        return WaitedTooLong(f"it waited {self.settings.timeout:g} s for earlier requests to {self.name}")

    def _deadline(self) -> float | None:
        """Return when the next request will have taken or waited too long."""
        turn = self._present
        if turn is not None and not turn.is_answered:
            first = self._waiting[0].expires_at if self._waiting else turn.expires_at
            return min(first, turn.expires_at)
        return self._waiting[0].expires_at if self._waiting else None

    def _check_in_one_turn(self, pdu: bytes, function: int) -> RequestPdu:
        """Check a write to bits; what is written instead is checked when the register is known."""
        return self._check_places(self._profile.check_in_one_turn(pdu, function))

    def _has(self, span: Span) -> bool:
        return covers(self.settings.areas.get(span.area, ()), span)

    def _tell(self, request: Request, error: RequestError) -> None:
        if not isinstance(error, _UNTOLD):
            super()._tell(request, error)
