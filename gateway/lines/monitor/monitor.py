"""Finds the transactions of others on a bus where the gateway only listens.

Nobody says which request a frame answers. So the values of an answer are believed only if it can belong to no other:

- request and answer were heard whole, next to each other, and neither can be read both as a request and as a response;
- no other request of the same unit and function is without an answer, until its late window has ended. The same request
  once more is no other one: an answer to either says what the unit holds;
- nothing was heard within that time that may have been such a request: no broken frame, no damaged byte; and the port
  was open.

Values are as old as the request.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Final

from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.monitor.requests import Doubt, HeardRequest, HeardRequests, Key
from gateway.lines.monitor.succession import Part, Stretch, Succession
from gateway.lines.settings import LineSettings
from gateway.lines.telling import Telling
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, WITHOUT_EFFECT
from gateway.modbus.frame import Frame
from gateway.modbus.functions import BROADCAST_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, parse_sent
from gateway.modbus.scan import Token
from gateway.timing.usage import Usage
from gateway.trace.records import Sent
from gateway.trace.ring import Ring

#: Returns the late window of a request to a unit on the wire, in seconds.
Windows = Callable[[int, RequestPdu], float]

#: Who has asked, in the trace and the usage of the line.
OTHER_CLIENT: Final = "another client"
#: What an adapter or a network may hold back, in seconds: windows are longer by that.
_HELD_BACK: Final = 0.1
#: The port is looked at so often. If it was not for so long, the gateway stood still. In seconds.
_LOOK: Final = 1.0
_STOOD_STILL: Final = 2.0


@dataclass(frozen=True, slots=True)
class HeardTransaction:
    """A request that somebody sent to `unit`, and its response; None if none was heard within its late window.

    It is told at its response, or when the window has ended: another one that was asked later may have been told
    before. So its effects are to be ordered by `asked_at`: that is when the request ended, or was sent for the first
    time, or may have come at the earliest if the gateway stood still. Its values may be taken if it `is_sure`.
    """

    unit: int
    asked: RequestPdu
    response: Frame | None
    asked_at: float
    answered_at: float
    is_sure: bool

    @property
    def may_have_written(self) -> bool:
        """Whether it may have changed values of the unit: unless it only reads, or was surely refused."""
        if self.asked.only_reads or self.response is None or not self.is_sure:
            return not self.asked.only_reads
        pdu = self.response.pdu
        return not (pdu[0] & EXCEPTION_BIT and pdu[1] in WITHOUT_EFFECT)


@dataclass(slots=True)
class MonitorCounts:
    """What was heard since the start.

    Requests; those with an answer, and those of them that are `sure`; those without one. Responses that answer no
    request that was heard, and requests that violate the specification. Frames that can be read `both_ways`. Stretches
    of bytes that belong to no frame (`noise`), but for what switching a driver leaves. `requests_to` counts requests by
    unit.
    """

    requests: int = 0
    answers: int = 0
    sure: int = 0
    unanswered: int = 0
    strays: int = 0
    both_ways: int = 0
    noise: int = 0
    requests_to: dict[int, int] = field(default_factory=dict)


class Monitor:
    """Finds the transactions of others in the bytes of a line, and tells `heard` of each.

    There is no I/O here: bytes and time are arguments, and `deadline` is when to call `tick`, after everything that has
    arrived at the port. `places` are number and name of the units on the wire, for the trace.
    """

    def __init__(
        self,
        settings: LineSettings,
        windows: Windows,
        emit: Emit,
        ring: Ring,
        heard: Callable[[HeardTransaction, float], None],
        places: Mapping[int, tuple[int, str]] | None = None,
    ) -> None:
        self.settings = settings
        self.counts = MonitorCounts()
        #: For how many seconds requests and answers were on the line, or awaited; and who has used it.
        self.busy = 0.0
        self.usage = Usage()
        self._windows = windows
        self._ring = ring
        self._tell = heard
        self._places = places or {}
        self._telling = Telling(settings.name, settings.source, emit, settings.timing.mode, ring)
        self._is_up = False
        self._parts = self._succession()
        self._requests = HeardRequests()
        self._doubt = Doubt()
        #: The request that was heard last, if nothing has followed it; a stretch, and the request before it.
        self._before: HeardRequest | None = None
        self._stretch: tuple[Stretch, HeardRequest | None] | None = None
        self._last: Frame | None = None

    def port_up(self, now: float) -> None:
        """Begin to listen, perhaps in the middle of something."""
        self._is_up = True
        self._parts = self._succession()
        self._doubt.add(now)
        self._doubt.empty_at = now

    def port_down(self, now: float) -> None:
        """Stop listening, because the port was lost. The answers to all that was asked are not heard any more."""
        self._is_up = False
        self._end_all(now, inf)
        self._before = self._stretch = None

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes; at least one of `damaged` ones differs from what was sent."""
        if damaged:
            self._doubt.add(now)
        for part in self._parts.received(data, now, damaged=damaged):
            self._take(part)

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is no need to."""
        if not self._is_up:
            return None
        begun = self._parts.deadline()
        return min(self._requests.next_end, self._doubt.empty_at + _LOOK) if begun is None else begun

    def tick(self, now: float) -> None:
        """Let time pass: everything that has arrived at the port was received."""
        if not self._is_up:
            return
        for part in self._parts.tick(now):
            self._take(part)
        if self._parts.is_between:
            self._doubt.empty_at = now
            if now >= self._requests.next_end:
                self._end_all(now, now)

    def _succession(self) -> Succession:
        return Succession(self.settings.timing.mode, self.settings.frame_end)

    def _take(self, part: Part) -> None:
        """Take the next frame, or what lies before it."""
        before, self._before = self._before, None
        if isinstance(part, Stretch):
            self._take_stretch(part, before)
        else:
            self._take_frame(part, before)

    def _take_frame(self, token: Token, before: HeardRequest | None) -> None:
        frame = token.frame
        pdu = frame.pdu
        key = frame.unit, pdu[0] & ~EXCEPTION_BIT
        fits = self._requests.fitting(key, pdu)
        is_twofold = self._parts.is_twofold(frame)
        self.counts.both_ways += is_twofold
        asked = None if fits else _request_in(pdu)
        is_again = before is None and frame == self._last  # the same answer twice, or another one that looks the same
        is_known = self._stretch is not None and self._judge(answer=None if fits or asked is not None else frame)
        if asked is not None:
            self._take_request(token, asked, is_twofold=is_twofold)
        elif fits and not is_again:
            self._take_answer(token, fits, before, is_twofold=is_twofold)
        else:
            self._take_stray(token, key, is_known=is_known or is_again)
        self._last = frame

    def _take_request(self, token: Token, asked: RequestPdu, *, is_twofold: bool) -> None:
        unit, at = token.frame.unit, token.at
        counts = self.counts
        counts.requests += 1
        counts.requests_to[unit] = counts.requests_to.get(unit, 0) + 1
        request = HeardRequest(unit, asked, token.end, at)
        if at - self._doubt.empty_at > _STOOD_STILL:
            request.asked_at = self._doubt.empty_at
        request.begun_at = at - self.settings.timing.frame(len(asked.data))
        request.is_twofold = is_twofold
        if unit == BROADCAST_UNIT or not asked.is_answered:
            if asked.function not in BROADCAST_FUNCTIONS and asked.is_answered:
                self._doubt.add(at)  # a device that is alone may answer, from its own address
            self._finish(request, None, at, is_sure=False)
            return
        window = self._windows(unit, asked) + _HELD_BACK
        self._doubt.note_window(unit, window)
        request.ends_at = at + window
        self._before = request
        oldest = self._requests.add(request)
        if oldest is not None:
            self._doubt.add(at)
            self._end(oldest, at)

    def _take_answer(
        self, token: Token, fits: list[HeardRequest], before: HeardRequest | None, *, is_twofold: bool
    ) -> None:
        """Take the answer to one of the requests that it `fits`: for what is still owed, the oldest of them."""
        answered = before if before in fits else next((each for each in fits if not each.is_told), None)
        is_sure = answered is before and not is_twofold and self._is_sure(answered, token.frame.pdu)
        if is_twofold or answered is not before:
            # it may be a request, and the other one still without an answer; or what lies between was a request
            self._doubt.add_to(fits[0].key, token.at)
        if answered is None:
            self.counts.strays += 1
            self._telling.record_heard(token, "nobody")
        else:
            answered.is_told = True
        self._requests.settle(fits[0])
        self._requests.note_answer(token.frame.unit, token.at, is_next=answered is before)
        if answered is not None:
            self.counts.answers += 1
            self.counts.sure += is_sure
            answered.asked_at = fits[0].asked_at
            self._finish(answered, token.frame, token.at, is_sure=is_sure)

    def _is_sure(self, request: HeardRequest | None, pdu: bytes) -> bool:
        """Tell whether the frame behind a request can only be its answer, and no copy of it."""
        if request is None or pdu == request.asked.data:
            return False
        return self._requests.is_alone(request) and not self._doubt.is_about(request.key)

    def _take_stray(self, token: Token, key: Key, *, is_known: bool) -> None:
        """Take a response to nothing that was heard, or a request that violates the specification.

        Unless it `is_known` where it comes from, the unit may have been asked what was not heard.
        """
        self.counts.strays += 1
        self._requests.note_answer(token.frame.unit, token.at, is_next=False)
        if not is_known:
            self._doubt.add_to(key, token.at)
        self._telling.record_heard(token, "nobody")

    def _take_stretch(self, stretch: Stretch, before: HeardRequest | None) -> None:
        if self._stretch is not None:
            self._judge(answer=None)
        self._stretch = stretch, before
        self.counts.noise += not stretch.is_glitch
        self._telling.record_noise(stretch.data, stretch.count, stretch.at)

    def _judge(self, *, answer: Frame | None) -> bool:
        """Doubt everything if the last stretch may have been a request; `answer` follows it, and answers no other.

        Return whether it is the answer to that request.
        """
        assert self._stretch is not None  # noqa: S101 - see the callers
        (stretch, before), self._stretch = self._stretch, None
        if stretch.is_glitch or (before is not None and self._parts.is_damaged_answer(stretch, before)):
            return False  # a request whose answer was damaged stays without one
        if answer is not None and self._parts.is_damaged_request(stretch, answer):
            return True
        self._doubt.add(stretch.at)
        return False

    def _end_all(self, now: float, until: float) -> None:
        """End the requests whose windows end up to `until`."""
        for each in self._requests.take_ended(until):
            self._end(each, now)

    def _end(self, request: HeardRequest, now: float) -> None:
        """End a request that no answer can come to any more."""
        if not request.is_told:
            self.counts.unanswered += 1
            self._finish(request, None, now, is_sure=False)

    def _finish(self, request: HeardRequest, response: Frame | None, at: float, *, is_sure: bool) -> None:
        """Record and tell what has become of a request."""
        unit, asked = request.unit, request.asked
        used = (request.came_at if response is None else at) - request.begun_at
        self.busy += used
        self.usage.add(OTHER_CLIENT, unit, asked.function, used)
        if self._ring.is_on:
            self._record(request, response, at)
        self._tell(HeardTransaction(unit, asked, response, request.asked_at, at, is_sure), at)

    def _record(self, request: HeardRequest, response: Frame | None, at: float) -> None:
        number, name = self._places.get(request.unit, (request.unit, ""))
        limit = 0.0 if request.ends_at == inf else request.ends_at - request.came_at
        pdu = None if response is None else response.pdu
        times = request.begun_at, request.begun_at, request.came_at, limit
        self._ring.add(
            Sent(at, self.settings.name, name, OTHER_CLIENT, number, request.unit, request.asked.data, pdu, *times)
        )


def _request_in(pdu: bytes) -> RequestPdu | None:
    """Return the request that a PDU is; None if it is none, or violates the specification."""
    try:
        return parse_sent(pdu)
    except RequestError:
        return None
