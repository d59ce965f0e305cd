"""The transaction machine of one line: one request at a time, a silence before it, a limit after it, only its response.

    down ──port_up──▶ idle ──submit──▶ (quiet long enough?) ──write──▶ awaiting ──response, limit──▶ idle
                       ▲                                        └─broadcast──▶ turnaround ─────────────┘

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from gateway.errors import BrokenResponse, LineDown, LineLost, QueueFull, ResponseTimeout, WaitedTooLong
from gateway.events import BadFrame, Emit, ForeignFrame, RequestTimeout
from gateway.events import QueueFull as QueueFullEvent
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.modbus.chartime import LineTiming
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.frame import Frame, ResponseFramer


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How one line behaves; all times in seconds.

    `gap` is the silence before each request, `silence` the one that ends a frame of unknown size, `turnaround` the one
    after a broadcast.
    """

    name: str
    timing: LineTiming
    gap: float
    silence: float
    turnaround: float
    queue: int = 64
    max_wait: float = 2.0
    broadcast: bool = True
    source: str = ""


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
    """One line and its transactions. `framer` is that of the line's mode."""

    def __init__(self, settings: LineSettings, framer: ResponseFramer, emit: Emit) -> None:
        self.settings = settings
        self.counts = Counts()
        self._framer = framer
        self._emit = emit
        self._queue = WaitingQueue(settings.queue, settings.max_wait)
        self._write: Callable[[bytes], None] | None = None
        self._latency = 0.0
        self._current: Transaction | None = None
        self._fails_at = 0.0
        self._quiet_at = 0.0

    @property
    def busy(self) -> bool:
        """Whether a request is on the line or waits for it."""
        return self._current is not None or len(self._queue) > 0

    def port_up(self, write: Callable[[bytes], None], latency: float, now: float) -> None:
        """The port is open: requests go out through `write`. `latency` is what it may add to an answer, in seconds."""
        self._write = write
        self._latency = latency
        self._quiet_at = now + self.settings.gap

    def port_down(self) -> None:
        """The port has gone: what was on the line may have been acted on (0B), what waited was not sent (0A)."""
        self._write = None
        current, self._current = self._current, None
        waiting = self._queue.clear()
        if current is not None:
            current.request.fail(LineLost())
        for transaction in waiting:
            transaction.request.fail(LineDown())

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when its turn comes and the line is quiet, or it fails."""
        if self._write is None:
            transaction.request.fail(LineDown())
        elif self._queue.put(transaction, now):
            self._go_on(now)
        else:
            self.counts.queue_full += 1
            client = transaction.request.origin.client
            self._emit(QueueFullEvent(self.settings.name, transaction.unit, transaction.device, client))
            transaction.request.fail(QueueFull())

    def received(self, data: bytes, now: float) -> None:
        """Take bytes that became readable at `now`."""
        quiet_at = now + self.settings.gap
        if self._current is None:
            self._quiet_at = max(self._quiet_at, quiet_at)
            self.counts.unasked_bytes += len(data)
            return
        self._quiet_at = quiet_at
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
            self._fail_current(self._current, now)
        self._go_on(now)

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and refuse those that have waited too long."""
        late = self._queue.expired(now)
        if self._current is None and self._write is not None and now >= self._quiet_at:
            transaction = self._queue.take()
            if transaction is not None:
                self._send(transaction, self._write, now)
        self.counts.waited_too_long += len(late)
        for transaction in late:
            transaction.request.fail(WaitedTooLong())

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        transaction.sent(now, self._latency)
        self.counts.sent += 1
        frame = self._framer.encode(transaction.unit, transaction.asked.data)
        if transaction.is_broadcast:
            self.counts.broadcasts += 1
            self._quiet_at = transaction.ends_at + self.settings.turnaround
            write(frame)
            transaction.request.end()
            return
        self._framer.expect(transaction.unit, transaction.asked)
        self._current = transaction
        self._fails_at = transaction.fails_at
        self._quiet_at = transaction.ends_at + self.settings.gap
        write(frame)

    def _judge(self, frames: list[Frame], now: float) -> None:
        """Finish the current transaction with the frame that fits it; others are dropped, the limit keeps running."""
        for frame in frames:
            current = self._current
            if current is not None and frame.unit == current.unit and current.asked.accepts(frame.pdu):
                self.counts.responses += 1
                self.counts.exceptions += frame.pdu[0] >= EXCEPTION_BIT
                self._finish(partial(current.request.respond, frame.pdu), now)
            else:
                self._drop(frame, current)

    def _drop(self, frame: Frame, current: Transaction | None) -> None:
        self.counts.foreign_frames += 1
        device = current.device if current is not None else ""
        text = bytes((frame.unit,)).hex().upper() + " " + frame.pdu.hex(" ").upper()
        self._emit(ForeignFrame(self.settings.name, frame.unit, device, frame.pdu[0], text))

    def _fail_current(self, current: Transaction, now: float) -> None:
        """The limit has run out: say what was heard instead of the response."""
        passed_over = self._framer.conclude()
        for frame in passed_over:
            self._drop(frame, current)
        heard = bool(passed_over) or self._framer.heard_noise
        self.counts.broken += heard
        self.counts.timeouts += not heard
        tell = BadFrame if heard else RequestTimeout
        error = BrokenResponse() if heard else ResponseTimeout()
        self._emit(
            tell(
                line=self.settings.name,
                unit=current.unit,
                device=current.device,
                function=current.asked.function,
                elapsed_ms=round((now - current.ends_at) * 1000, 1),
                limit_ms=round(current.limit * 1000, 1),
                source=current.source,
            )
        )
        self._finish(partial(current.request.fail, error), now)

    def _finish(self, answer: Callable[[], None], now: float) -> None:
        """The transaction is over. The next request goes out before the answer is sent on."""
        self._current = None
        self._go_on(now)
        answer()

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "idle"
        return f"<Line {self.settings.name} {state} waiting={len(self._queue)}>"
