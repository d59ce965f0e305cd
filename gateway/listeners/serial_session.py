"""The outside client of a line where we are a server: its requests are heard, and answered in time or not at all.

    | state     | what happens                | what is done                         | next state |
    |-----------|-----------------------------|--------------------------------------|------------|
    | down      | the port is open            |                                      | listening  |
    | listening | a request for our units     | it is handed to the router           | asked      |
    | listening | any other frame             | it is counted, a broadcast handed on | listening  |
    | asked     | the router has answered     | the answer is kept                   | answered   |
    | asked     | there is no answer          |                                      | listening  |
    | asked     | anything is heard           | the answer will be dropped           | listening  |
    | answered  | anything is heard           | the answer is dropped                | listening  |
    | answered  | the line was quiet for t3.5 | the answer is put on the line        | listening  |
    | asked, answered | `answer_within` is over | the answer is dropped              | listening  |
    | any       | the port has gone           | the answer is dropped                | down       |

Nothing on the line ties a response to its request: the client takes the next response that fits for the answer to what
it asked last. So an answer that may not be awaited any more is never put on the line. Other servers may be on it too:
their frames are heard and not answered.

The machine knows no clock and no descriptor, as `lines.line`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gateway import events
from gateway.listeners.failures import OnFailure, is_kept_back
from gateway.listeners.own_echo import OwnEcho
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.frame import Frame, RequestFramer
from gateway.modbus.rtu import RtuFramer
from gateway.ports.wire import Wire
from gateway.request import Request, Target
from gateway.timing.characters import LineTiming

#: So many bytes right behind a request are what switching an RS-485 line leaves; more are the next frame.
_GLITCH: Final = 3


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """A line where we are a server; all times in seconds.

    `serves` are the units that we answer for. `idle_chars` is the silence that ends an RTU frame, in characters. `gap`
    is the silence before each response, None for that same silence.
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
        """The silence that ends a frame: none in ASCII, whose frames show their own ends."""
        return 0.0 if self.timing.mode == "ascii" else self.timing.silence(self.idle_chars)

    @property
    def silence_before_response(self) -> float:
        """How long the line is quiet before each response (S 2.5.1.1)."""
        return self.frame_end if self.gap is None else self.gap


@dataclass(slots=True)
class Counts:
    """What has happened on a server line since it was built.

    Each of the `requests` to our units gets a response (some are `exceptions`), or none: it has none, or was a failure
    that is kept `silent`, the answer came `too_late`, or was `overtaken` by what was heard next.
    """

    requests: int = 0
    responses: int = 0
    exceptions: int = 0
    silent: int = 0
    too_late: int = 0
    overtaken: int = 0
    broadcasts: int = 0
    foreign_frames: int = 0
    noise: int = 0
    echoes: int = 0


class SerialSession:
    """The Origin of the outside client's requests, one at a time.

    `wake` is called when `deadline` has changed outside of the calls that the driver makes. It must not call back.
    """

    #: There is no address on a line.
    host = ""

    def __init__(self, settings: ServerSettings, router: Target, wake: Callable[[], None], emit: events.Emit) -> None:
        self.settings = settings
        self.client = settings.name
        self.counts = Counts()
        self._router = router
        self._wake = wake
        self._emit = emit
        self._write: Callable[[bytes], None] | None = None
        self._echo = OwnEcho(settings.name, settings.source, emit, echoes=settings.echo)
        self._current: Request | None = None
        self._answer = b""
        self._heard_at = 0.0
        self._quiet_at = 0.0
        self._glitch_until = 0.0
        self._is_ending = False
        self._tune(latency=0.0)

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is under way."""
        return self._current is None

    def port_up(self, write: Callable[[bytes], None], latency: float, now: float, *, virtual: bool = True) -> None:
        """The port is open: responses go out through `write`. What is received may be late by `latency` seconds.

        A `virtual` one carries bytes at once: the next request can come before a response would have left a real line.
        """
        self._tune(latency)
        self._write = write
        self._echo.is_virtual = virtual
        self._quiet_at = now

    def port_down(self) -> None:
        """The port has gone: nobody waits for the answer."""
        self._write = None
        self._drop()
        self._tune(self._latency)

    def finish(self) -> None:
        """Take no more requests; the one that is under way is still answered."""
        self._is_ending = True

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes that became readable at `now`. No frame with all of `damaged` ones in it is a request."""
        self._heard_at = now
        self._quiet_at = max(self._quiet_at, now + self.settings.silence_before_response)
        self._hear(self._framer.received(data, now, damaged=damaged), now)
        self._go_on(now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        silence = self._framer.deadline()
        if self._current is None:
            return silence
        due = self._expires_at(self._current)
        if silence is not None:
            return min(due, silence)
        return min(due, self._quiet_at) if self._answer else due

    def tick(self, now: float) -> None:
        """Let time pass: silence may have ended a frame, an answer may be due, or too late."""
        self._hear(self._framer.tick(now), now)
        self._go_on(now)

    def wants(self, request: Request) -> bool:
        """Whether a request that still waits should be sent: nobody waits for the answer to a broadcast."""
        return request is self._current or request.unit == BROADCAST_UNIT

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Keep the answer to a request; `tick` puts it on the line when that is quiet, if the client still awaits it.

        The driver reads what has arrived before it calls `tick`.
        """
        if request is not self._current:
            return
        if pdu is None or is_kept_back(request, self.settings.on_failure):
            self.counts.silent += 1
            self._drop()
            return
        self._answer = pdu
        self._wake()

    def _tune(self, latency: float) -> None:
        """Begin to hear anew, on a port of this latency."""
        settings = self.settings
        self._latency = latency
        self._framer: RequestFramer = AsciiFramer()
        if settings.timing.mode == "rtu":  # with an echo, responses come from our own units too
            ours: frozenset[int] = frozenset() if settings.echo else settings.serves
            self._framer = RtuFramer(settings.frame_end + latency, ours)

    def _hear(self, frames: list[Frame], now: float) -> None:
        for frame in frames:
            self._take(frame, now)
        self.counts.noise += self._framer.heard_noise
        self._framer.heard_noise = False
        if self._current is not None and self._is_followed():
            self._overtake(self._current, now)

    def _take(self, frame: Frame, now: float) -> None:
        if self._echo.is_echo(frame, self._heard_at):
            self.counts.echoes += 1
            return
        if self._current is not None:
            self._overtake(self._current, now)
        if self._is_ending or self._write is None:
            return
        request = Request(frame.unit, frame.pdu, self, now)
        if frame.unit == BROADCAST_UNIT:
            self.counts.broadcasts += 1
        elif frame.unit in self.settings.serves and frame.pdu[0] < EXCEPTION_BIT:
            self.counts.requests += 1
            self._current = request
            self._glitch_until = now + self.settings.timing.t35 + self._latency
        else:
            self.counts.foreign_frames += 1
            return
        self._router.submit(request, now)

    def _is_followed(self) -> bool:
        """Whether somebody has begun to send since the request: most likely the client, which asks something else."""
        behind = self._framer.behind
        return behind > _GLITCH or (behind > 0 and self._heard_at > self._glitch_until)

    def _go_on(self, now: float) -> None:
        """Put the answer on the line if the client still waits for it and everybody else is silent."""
        if self._current is None or self._write is None:
            return
        if now >= self._expires_at(self._current):
            self.counts.too_late += 1
            self._withhold(self._current, "it was not there within answer_within", now)
        elif self._answer and now >= self._quiet_at and self._framer.deadline() is None:
            self._respond(self._current, self._answer, self._write, now)

    def _respond(self, request: Request, pdu: bytes, write: Callable[[bytes], None], now: float) -> None:
        self._drop()
        response = Frame(request.unit, pdu)
        self.counts.responses += 1
        self.counts.exceptions += pdu[0] >= EXCEPTION_BIT
        adu = self._framer.encode(*response)
        leaves_at = now + self.settings.timing.frame(len(pdu))
        self._quiet_at = leaves_at + self.settings.silence_before_response
        until = leaves_at + self.settings.timing.t35 + max(leaves_at - now, self._latency)
        self._echo.said(response, until, is_repeatable=pdu == request.pdu)
        write(adu)

    def _overtake(self, request: Request, now: float) -> None:
        self.counts.overtaken += 1
        self._withhold(request, "something else was heard before it was there", now)

    def _withhold(self, request: Request, reason: str, now: float) -> None:
        """The client does not wait for this answer any more, or would take it for another one."""
        self._drop()
        name, source, elapsed = self.client, self.settings.source, round((now - request.received_at) * 1000, 1)
        self._emit(events.AnswerWithheld(name, request.unit, request.pdu[0], elapsed, reason, source))

    def _drop(self) -> None:
        self._current = None
        self._answer = b""

    def _expires_at(self, request: Request) -> float:
        return request.received_at + self.settings.answer_within

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "listening"
        return f"<SerialSession {self.client} {state}>"
