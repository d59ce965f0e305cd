"""The transaction machine of one line: one request at a time, a silence before it, a limit after it, only its response.

    down ──port_up──▶ idle ──submit──▶ (quiet long enough?) ──write──▶ awaiting ──response, limit──▶ idle
                       ▲                                        └─broadcast──▶ turnaround ─────────────┘

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from gateway.errors import (
    BrokenResponse,
    LineDown,
    LineLost,
    QueueFull,
    RequestError,
    ResponseTimeout,
    WaitedTooLong,
)
from gateway.events import BadFrame, Emit, ForeignFrame, RequestTimeout
from gateway.events import QueueFull as QueueFullEvent
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.chartime import LineTiming
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.frame import Frame, ResponseFramer
from gateway.modbus.rtu import ResponseFramer as RtuFramer
from gateway.timing.budget import Budget

#: Silence after a device has answered that it changes its rate, in seconds: time for it, and for our own port.
RATE_CHANGE_PAUSE: Final = 0.1

#: Is shown each transaction that was on the line, its answer or None, and when that was known.
Observer = Callable[[Transaction, Frame | None, float], None]


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How one line behaves; all times in seconds.

    `idle_chars` is the silence that ends an RTU frame for all its devices, in characters. `gap` is the silence before
    each request, None for that same silence. `turnaround` is the silence after a broadcast.
    """

    name: str
    timing: LineTiming
    turnaround: float
    idle_chars: float = 3.5
    gap: float | None = None
    queue: int = 64
    max_wait: float = 2.0
    broadcast: bool = True
    source: str = ""

    @property
    def frame_end(self) -> float:
        """The silence that ends a frame: none in ASCII, whose frames show their own ends."""
        return 0.0 if self.timing.mode == "ascii" else self.timing.silence(self.idle_chars)

    @property
    def silence_before_request(self) -> float:
        """How long the line is quiet before each request."""
        return self.frame_end if self.gap is None else self.gap


@dataclass(slots=True)
class Counts:
    """What has happened on a line since it was built."""

    sent: int = 0
    responses: int = 0
    exceptions: int = 0
    timeouts: int = 0
    broken: int = 0
    foreign_frames: int = 0
    unasked_bytes: int = 0
    broadcasts: int = 0
    queue_full: int = 0
    waited_too_long: int = 0


class Line:
    """One line and its transactions. `observer`, if there is one, is shown each of them."""

    def __init__(self, settings: LineSettings, emit: Emit) -> None:
        self.settings = settings
        self.counts = Counts()
        self.observer: Observer | None = None
        self._emit = emit
        self._queue = WaitingQueue(settings.queue, settings.max_wait)
        self._write: Callable[[bytes], None] | None = None
        self._current: Transaction | None = None
        self._fails_at = 0.0
        self._quiet_at = 0.0
        self._tune(latency=0.0)

    @property
    def busy(self) -> bool:
        """Whether a request is on the line or waits for it."""
        return self._current is not None or len(self._queue) > 0

    def port_up(self, write: Callable[[bytes], None], latency: float, now: float) -> None:
        """The port is open: requests go out through `write`. `latency` is what it may add to an answer, in seconds."""
        self._tune(latency)
        self._write = write
        self._quiet_at = now + self._gap

    def port_down(self, now: float) -> None:
        """The port has gone: what was on the line may have been acted on (0B), what waited was not sent (0A)."""
        self._write = None
        waiting = self._queue.clear()
        if self._current is not None:
            self._finish(self._current, LineLost(), now)
        for transaction in waiting:
            transaction.request.fail(LineDown())

    def change_rate(self, baud: int, now: float) -> None:
        """The devices, and the port with them, change to another rate: nothing is sent for a moment."""
        self.settings = replace(self.settings, timing=replace(self.settings.timing, baud=baud))
        self._tune(self._budget.latency)
        self._quiet_at = now + RATE_CHANGE_PAUSE

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when its turn comes and the line is quiet, or it fails."""
        if self._write is None:
            transaction.request.fail(LineDown())
        elif self._queue.put(transaction, now):
            self._go_on(now)
        else:
            self.counts.queue_full += 1
            client, device = transaction.request.origin.client, transaction.device
            self._emit(QueueFullEvent(self.settings.name, transaction.unit, device.name, client))
            transaction.request.fail(QueueFull())

    def received(self, data: bytes, now: float) -> None:
        """Take bytes that became readable at `now`."""
        if self._current is None:
            self._quiet_at = max(self._quiet_at, now + self._gap)
            self.counts.unasked_bytes += len(data)
            return
        self._quiet_at = now + self._gap
        self._judge(self._framer.received(data, now), now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        expiry = self._queue.next_expiry()
        if self._current is None:
            return None if expiry is None else min(expiry, self._quiet_at)
        deadline = self._fails_at
        silence = self._framer.deadline()
        if silence is not None and silence < deadline:
            deadline = silence
        return deadline if expiry is None or expiry > deadline else expiry

    def tick(self, now: float) -> None:
        """Let time pass: a silence may have ended a response, a limit may have run out, the line may be quiet again."""
        if self._current is not None:
            self._judge(self._framer.tick(now), now)
        if self._current is not None and now >= self._fails_at:
            self._give_up(self._current, now)
        self._go_on(now)

    def _tune(self, latency: float) -> None:
        """Work out what follows from the line's timing and its port's latency."""
        settings = self.settings
        self._budget = Budget(settings.timing, latency)
        self._gap = settings.silence_before_request
        self._framer: ResponseFramer = (
            AsciiFramer() if settings.timing.mode == "ascii" else RtuFramer(settings.frame_end + latency)
        )

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and refuse those that have waited too long."""
        late = self._queue.expired(now)
        while self._current is None and self._write is not None and now >= self._quiet_at:
            transaction = self._queue.take()
            if transaction is None:
                break
            self._send(transaction, self._write, now)
        self.counts.waited_too_long += len(late)
        for transaction in late:
            transaction.request.fail(WaitedTooLong())

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        try:
            transaction.start(self._budget, now)
        except RequestError as error:
            transaction.request.fail(error)
            return
        self.counts.sent += 1
        if transaction.expects_answer:
            self._framer.expect(transaction.answers_from, transaction.asked)
            self._current = transaction
            self._fails_at = transaction.fails_at
            self._quiet_at = transaction.ends_at + self._gap
        else:
            self.counts.broadcasts += 1
            self._quiet_at = transaction.ends_at + self.settings.turnaround
        write(self._framer.encode(transaction.unit, transaction.asked.data))
        if not transaction.expects_answer:
            transaction.request.end()

    def _judge(self, frames: list[Frame], now: float) -> None:
        """Finish the current transaction with the frame that fits it; others are dropped, the limit keeps running."""
        for frame in frames:
            if self._current is not None and self._current.accepts(frame):
                self.counts.responses += 1
                self.counts.exceptions += frame.pdu[0] >= EXCEPTION_BIT
                self._finish(self._current, frame, now)
            else:
                self._drop(frame)

    def _drop(self, frame: Frame) -> None:
        self.counts.foreign_frames += 1
        device = self._current.device.name if self._current is not None else ""
        text = bytes((frame.unit,)).hex().upper() + " " + frame.pdu.hex(" ").upper()
        self._emit(ForeignFrame(self.settings.name, frame.unit, device, frame.pdu[0], text))

    def _give_up(self, current: Transaction, now: float) -> None:
        """The limit has run out: say what was heard instead of the response."""
        passed_over = self._framer.conclude()
        for frame in passed_over:
            self._drop(frame)
        heard = bool(passed_over) or self._framer.heard_noise
        self.counts.broken += heard
        self.counts.timeouts += not heard
        tell = BadFrame if heard else RequestTimeout
        self._emit(
            tell(
                line=self.settings.name,
                unit=current.unit,
                device=current.device.name,
                function=current.asked.function,
                elapsed_ms=round((now - current.ends_at) * 1000, 1),
                limit_ms=round(current.limit * 1000, 1),
                source=current.device.source,
            )
        )
        self._finish(current, BrokenResponse() if heard else ResponseTimeout(), now)

    def _finish(self, transaction: Transaction, outcome: Frame | RequestError, now: float) -> None:
        """The transaction is over. The next request goes out before the answer is sent on."""
        response = outcome if isinstance(outcome, Frame) else None
        self._current = None
        transaction.device.finished(transaction, response)
        if self.observer is not None:
            self.observer(transaction, response, now)
        self._go_on(now)
        if isinstance(outcome, Frame):
            transaction.request.respond(outcome.pdu)
        else:
            transaction.request.fail(outcome)

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "idle"
        return f"<Line {self.settings.name} {state} waiting={len(self._queue)}>"
