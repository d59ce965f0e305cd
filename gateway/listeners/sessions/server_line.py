"""The client on a server line: its requests are answered in time or not at all.

    | state     | what happens                | what is done                         | next state |
    |-----------|-----------------------------|--------------------------------------|------------|
    | down      | the port is open            |                                      | listening  |
    | listening | a request for its units     | it is submitted to the router        | asked      |
    | listening | one read too late for that, | it gets no response                  | listening  |
    |           | or together with the next   |                                      |            |
    | listening | any other frame             | counted; a broadcast is passed on    | listening  |
    | asked     | the router has answered     | the response is kept                 | answered   |
    | asked     | there is no response        |                                      | listening  |
    | asked     | any byte is received        | the response will be dropped         | listening  |
    | answered  | any byte is received        | the response is dropped              | listening  |
    | answered  | the line was idle for t3.5  | the response is sent                 | listening  |
    | asked, answered | `answer_within` is over | the response is dropped            | listening  |
    | any       | the port is lost            | the response is dropped              | down       |

Nothing on the line ties a response to its request: the client takes the next response that fits as the one to its last
request. So a response that may no longer be awaited is never sent. Other servers may be on the line: their frames are
received and not answered.

The machine has no clock and no I/O, like `lines.line`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway import events
from gateway.errors import Busy
from gateway.listeners.sessions.own_echo import OwnEcho
from gateway.listeners.sessions.server_counts import ServerCounts
from gateway.listeners.settings import OnFailure, is_kept_back
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame, RequestFramer
from gateway.modbus.rtu import RtuFramer
from gateway.ports.port import Wire
from gateway.request import Caller, Origin, Request, Target
from gateway.timing.characters import LineTiming
from gateway.trace.records import Answered, Heard
from gateway.trace.ring import Ring

#: Up to this many bytes right behind a request are glitches of an RS-485 line; more are the next frame.
_GLITCH: Final = 3
#: Seconds between readings of an open port. Bytes read next have arrived since the last reading.
LOOK_STEP: Final = 0.05
#: Bytes count as arrived when they are read, unless the last reading is longer ago than this, in seconds.
UNNOTICED: Final = 0.1


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """The settings of a server line; all times in seconds.

    `serves` are the units that it answers for. `idle_chars` is the silence that ends an RTU frame, in characters. `gap`
    is the silence before each response; None: the same as `idle_chars`.
    """

    name: str
    timing: LineTiming
    serves: frozenset[int]
    idle_chars: float = 3.5
    gap: float | None = None
    echo: bool = False
    on_failure: OnFailure = "exception"
    answer_within: float = 1.0
    wire: Wire = "auto"
    source: str = field(default="", compare=False)

    @property
    def frame_end(self) -> float:
        """The silence that ends a frame, in seconds."""
        return self.timing.frame_end(self.idle_chars)

    @property
    def silence_before_response(self) -> float:
        """The silence before each response, in seconds (S 2.5.1.1)."""
        return self.frame_end if self.gap is None else self.gap


class SerialSession(Origin):
    """The Origin of the client's requests, one at a time.

    `wake` is called when `deadline` changes outside the driver's calls. It must not call back. `counts` may be those of
    other sessions too.
    """

    def __init__(
        self,
        settings: ServerSettings,
        router: Target,
        wake: Callable[[], None],
        emit: events.Emit,
        ring: Ring | None = None,
        counts: ServerCounts | None = None,
    ) -> None:
        self.settings = settings
        self.caller = Caller.without_address(settings.name)
        self.counts = counts or ServerCounts()
        self._router = router
        self._wake = wake
        self._emit = emit
        self._ring = ring or Ring()
        #: Sends bytes; None while the port is not open.
        self._write: Callable[[bytes], None] | None = None
        self._echo = OwnEcho(settings.name, settings.source, emit, echoes=settings.echo)
        #: The request in progress, and the PDU of its response, empty until there is one.
        self._current: Request | None = None
        self._answer = b""
        #: When the last bytes were read, and the earliest time at which they may have arrived.
        self._heard_at = self._heard_since = 0.0
        #: When the line will have been silent long enough for a response.
        self._quiet_at = 0.0
        #: Before this time a few bytes are taken for a glitch behind the request.
        self._glitch_until = 0.0
        self._is_ending = False
        self._tune(latency=0.0)

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return self._current is None

    def port_up(self, write: Callable[[bytes], None], latency: float, now: float, *, virtual: bool = True) -> None:
        """Send responses with `write` from now on. Received bytes may be late by `latency` seconds.

        A `virtual` port carries bytes at once: the next request can arrive before a real line has carried a response.
        """
        self._tune(latency)
        self._write = write
        self._echo.port_up(virtual=virtual)
        self._quiet_at = now

    def port_down(self) -> None:
        """Drop the response: the port is lost."""
        self._write = None
        self._drop()
        self._tune(self._latency)

    def adopt(self, settings: ServerSettings) -> None:
        """Answer for the units in these settings from now on; they are the same otherwise."""
        serves_others = settings.serves != self.settings.serves
        self.settings = settings
        if serves_others:
            self._tune(self._latency)

    def finish(self) -> None:
        """Accept no more requests; the one in progress is still answered."""
        self._is_ending = True

    def received(self, data: bytes, now: float, *, damaged: bool = False, since: float | None = None) -> None:
        """Process bytes read at `now`. A frame with `damaged` characters is never a request.

        If the gateway stood still, they may have arrived `since`: `answer_within` counts from then.
        """
        self._heard_at = now
        self._heard_since = now if since is None else since
        self._quiet_at = max(self._quiet_at, now + self.settings.silence_before_response)
        self._hear(self._framer.received(data, now, damaged=damaged), now)

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is no need to."""
        silence = self._framer.deadline()
        if self._current is None:
            return silence
        due = self._expires_at(self._current)
        if silence is not None:
            return min(due, silence)
        return min(due, self._quiet_at) if self._answer else due

    def tick(self, now: float) -> None:
        """Let time pass: silence may have ended a frame, a response may be due, or too late."""
        self._hear(self._framer.tick(now), now)
        request, write = self._current, self._write
        if request is None or write is None:
            return
        if now >= self._expires_at(request):
            self.counts.too_late += 1
            self._withhold(request, "it was not available within answer_within", now)
        elif self._answer and now >= self._quiet_at and self._framer.deadline() is None:
            self._respond(request, self._answer, write, now)

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting request should still be sent: always for a broadcast, which gets no response."""
        return request is self._current or request.unit == BROADCAST_UNIT

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Keep the response to a request; `tick` sends it when the line is quiet, if the client still waits for it.

        The driver reads received bytes before it calls `tick`.
        """
        if request is not self._current:
            return
        if pdu is None or is_kept_back(request, self.settings.on_failure):
            self.counts.silent += 1
            self._record(request, None, request.received_at, "it has no answer, or on_failure is silent")
            self._drop()
            return
        self._answer = pdu
        self._wake()

    def _tune(self, latency: float) -> None:
        """Start receiving on a port with this latency."""
        settings = self.settings
        self._latency = latency
        self._framer: RequestFramer = AsciiFramer()
        if settings.timing.mode == "rtu":  # with an echo, responses of the gateway's own units arrive too
            ours: frozenset[int] = frozenset() if settings.echo else settings.serves
            self._framer = RtuFramer(settings.frame_end + latency, ours)

    def _hear(self, frames: list[Frame], now: float) -> None:
        for place, frame in enumerate(frames, 1):
            self._take(frame, now, is_last=place == len(frames))
        self.counts.noise += self._framer.heard_noise
        self._framer.heard_noise = False
        if self._current is not None and self._has_newer_frame():
            self._overtake(self._current, now)

    def _take(self, frame: Frame, now: float, *, is_last: bool) -> None:
        verdict = self._echo.judge(frame, self._heard_at, self._heard_since)
        if verdict == "echo":
            self.counts.echoes += 1
            return
        if self._current is not None:
            self._overtake(self._current, now)
        if self._is_ending or self._write is None:
            return
        request = Request(frame.unit, frame.pdu, self, self._heard_since)
        if frame.unit == BROADCAST_UNIT:
            self.counts.broadcasts += 1
        elif frame.unit in self.settings.serves and frame.pdu[0] < EXCEPTION_BIT:
            self.counts.requests += 1
            self._current = request
            self._glitch_until = now + self.settings.timing.t35 + self._latency
            if not is_last or self._has_newer_frame() or now >= self._expires_at(request):
                return  # given up, or read too late: it is withheld
            if verdict == "doubtful":
                request.fail(Busy())
                return
        else:
            self.counts.foreign_frames += 1
            if self._ring.is_on:
                self._ring.add(Heard(now, self.settings.name, "nobody", bytes((frame.unit,)) + frame.pdu, 1))
            return
        self._router.submit(request, now)

    def _has_newer_frame(self) -> bool:
        """Tell whether bytes arrived after the request: most likely the client's next request."""
        behind = self._framer.behind
        is_right_behind = self._heard_at <= self._glitch_until and self._heard_at == self._heard_since
        return behind > (_GLITCH if is_right_behind else 0)

    def _respond(self, request: Request, pdu: bytes, write: Callable[[bytes], None], now: float) -> None:
        self._drop()
        response = Frame(request.unit, pdu)
        self.counts.responses += 1
        self.counts.exceptions += pdu[0] >= EXCEPTION_BIT
        adu = self._framer.encode(*response)
        leaves_at = now + self.settings.timing.frame(len(pdu))
        self._quiet_at = leaves_at + self.settings.silence_before_response
        until = leaves_at + self.settings.timing.t35 + max(leaves_at - now, self._latency)
        self._echo.note_response(response, until, is_repeatable=pdu == request.pdu)
        write(adu)
        self._record(request, pdu, now)

    def _overtake(self, request: Request, now: float) -> None:
        self.counts.overtaken += 1
        self._withhold(request, "other bytes were received before it was available", now)

    def _withhold(self, request: Request, reason: str, now: float) -> None:
        """Drop a response that the client does not await, or would take for another one."""
        self._drop()
        name, source, elapsed = self.settings.name, self.settings.source, round((now - request.received_at) * 1000, 1)
        self._emit(events.AnswerWithheld(name, request.unit, request.pdu[0], elapsed, reason, source))
        self._record(request, None, now, reason)

    def _record(self, request: Request, response: bytes | None, now: float, reason: str = "") -> None:
        """Record the response, or why there is none."""
        if self._ring.is_on:
            line, unit, asked = self.settings.name, request.unit, request.pdu
            self._ring.add(Answered(now, line, "", line, unit, asked, response, request.received_at, reason))

    def _drop(self) -> None:
        if self._current is not None:
            self._current.give_up()
        self._current = None
        self._answer = b""

    def _expires_at(self, request: Request) -> float:
        return request.received_at + self.settings.answer_within

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "listening"
        return f"<SerialSession {self.settings.name} {state}>"
