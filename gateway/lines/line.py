"""The transaction machine of one line: one request at a time, a silence before it, a limit after it, only its response.

    down ──port_up──▶ idle ──submit──▶ (quiet long enough?) ──write──▶ awaiting ──response, limit──▶ idle
                       ▲                                        └─broadcast──▶ turnaround ─────────────┘

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.echo import Echo
from gateway.lines.hearing import Hearing
from gateway.lines.late import WORTH_WAITING, LateResponse, LateWindows
from gateway.lines.queue import WaitingQueue
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.transaction import Addressee, Transaction
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import READING_FUNCTIONS
from gateway.modbus.frame import Frame, ResponseFramer
from gateway.modbus.rtu import ResponseFramer as RtuFramer
from gateway.timing.budget import Budget

#: Silence after a device has answered that it changes its rate, in seconds: time for it, and for our own port.
RATE_CHANGE_PAUSE: Final = 0.1

#: Is shown each transaction that was on the line, its answer or None, and when that was known.
Observer = Callable[[Transaction, Frame | None, float], None]


class Line:
    """One line and its transactions. `observer`, if there is one, is shown each of them."""

    def __init__(self, settings: LineSettings, emit: Emit) -> None:
        self.settings = settings
        #: Bytes that came while nothing was asked, and the seconds in which something was.
        self.unasked_bytes = 0
        self.busy_seconds = 0.0
        self.observer: Observer | None = None
        self._report = Report(settings.name, settings.source, emit)
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        self._late = LateWindows()
        self._echo = Echo() if settings.echo else None
        self._write: Callable[[bytes], None] | None = None
        self._is_virtual = True
        self._current: Transaction | None = None
        self._again: Transaction | None = None
        self._resting: set[Addressee] = set()
        self._hearing = Hearing()
        self._echo_suspected = False
        self._sent_at = 0.0
        self._fails_at = 0.0
        self._quiet_at = 0.0
        self._held_until = 0.0
        self._tune(latency=0.0)

    @property
    def waiting(self) -> int:
        """How many requests wait."""
        return len(self._queue)

    def late_windows(self, now: float) -> int:
        """How many late answers are awaited."""
        return self._late.count(now)

    def port_up(self, write: Callable[[bytes], None], latency: float, now: float, *, virtual: bool = True) -> None:
        """The port is open: requests go out through `write`.

        `latency` is what it may add to an answer, in seconds. A `virtual` one carries bytes at once: an answer can come
        before its request would have left a real line.
        """
        self._tune(latency)
        self._write = write
        self._is_virtual = virtual
        self._quiet_at = now + self._gap
        for device in self._resting:
            device.breaker.heard()
        self._resting.clear()

    def port_down(self, now: float) -> None:
        """The port has gone: what was on the line may have been acted on (0B), what waited was not sent (0A)."""
        self._write = None
        waiting = self._queue.clear()
        lost, self._again = self._current or self._again, None
        try:
            if lost is not None:
                self._open_late_window(lost, now, lost.owed + 1)
                self._finish(lost, errors.LineLost(), now)
        finally:
            _fail_all(waiting, errors.LineDown())

    def change_rate(self, baud: int, now: float) -> None:
        """The devices, and the port with them, change to another rate: nothing is sent for a moment."""
        self.settings = replace(self.settings, timing=replace(self.settings.timing, baud=baud))
        self._tune(self._budget.latency)
        self._quiet_at = now + RATE_CHANGE_PAUSE

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when its turn comes and the line is quiet, or it fails."""
        refusal = self._refusal(transaction, now)
        if refusal is not None:
            transaction.fail(refusal)
        elif self._queue.put(transaction, now):
            self._go_on(now)
        else:
            self._report.queue_full(transaction)
            transaction.fail(errors.QueueFull())

    def received(self, data: bytes, now: float) -> None:
        """Take bytes that became readable at `now`."""
        if self._again is not None:  # the line is not quiet: what comes may be the answer, so nothing is sent again
            given_up, self._again = self._again, None
            self._quiet_at = now + self._gap
            self._lose(given_up, now)
        late = self._late.received(data, now) if self._late.windows else []
        for response in late:
            self._take_late(response, now)
        if self._current is None:
            self._quiet_at = max(self._quiet_at, now + self._gap)
            if not late:
                self._hear_idle(data, now)
            self._go_on(now)
            return
        if self._echo is not None:
            data = self._echo.strip(data)
            self._hearing.early[:] = self._echo.before
        elif not self._is_virtual and now < self._current.ends_at:
            self._hearing.keep_early(data)
            return
        self._quiet_at = now + self._gap
        self._hearing.keep(data)
        self._judge(self._current, self._framer.received(data, now), now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        if self._current is not None:
            return _earliest(self._answer_deadline(), self._queue.next_expiry())
        if self._again is not None:
            return _earliest(self._quiet_at, self._queue.next_expiry())
        if not len(self._queue):
            return None
        return _earliest(max(self._quiet_at, self._held_until), self._queue.next_expiry())

    def tick(self, now: float) -> None:
        """Let time pass: a silence may have ended a response, a limit may have run out, the line may be quiet again."""
        if self._current is not None:
            self._judge(self._current, self._framer.tick(now), now)
        if self._current is not None and now >= self._answer_deadline():
            self._give_up(self._current, now)
        self._go_on(now)

    def _tune(self, latency: float) -> None:
        """Work out what follows from the line's timing and its port's latency."""
        self._budget = Budget(self.settings.timing, latency)
        self._gap = self.settings.silence_before_request
        self._framer = self._new_framer()

    def _new_framer(self) -> ResponseFramer:
        if self.settings.timing.mode == "ascii":
            return AsciiFramer()
        return RtuFramer(self.settings.frame_end + self._budget.latency)

    def _answer_deadline(self) -> float:
        """When the current transaction has failed. A response of unknown size that has begun may come to its end."""
        silence = self._framer.deadline()
        if silence is None or silence <= self._fails_at:
            return self._fails_at if silence is None else silence
        return min(silence, self._fails_at + self.settings.timing.longest_frame)

    def _refusal(self, transaction: Transaction, now: float) -> RequestError | None:
        """Why a transaction need not even wait."""
        if self._write is None:
            return errors.LineDown()
        if self._resting or self._echo_suspected:
            refusal = self._ban(transaction, now)
            if refusal is not None:
                return refusal
        if self._is_overdue(transaction, now):
            return errors.AnswerOverdue()
        return None

    def _ban(self, transaction: Transaction, now: float) -> RequestError | None:
        """Why a transaction must not be sent even if its turn has come."""
        if transaction.device.breaker.rests(now):
            return errors.UnitResting()
        asked = transaction.asked
        if self._echo_suspected and transaction.expects_answer and asked.accepts(asked.data):
            return errors.EchoSuspected()
        return None

    def _is_overdue(self, transaction: Transaction, now: float) -> bool:
        until = self._late.forbid_until(transaction, now) if self._late.windows else None
        return until is not None and until - now > WORTH_WAITING

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and refuse those that have waited too long."""
        late = self._queue.expired(now)
        try:
            self._held_until = 0.0
            while self._current is None and self._write is not None and now >= self._quiet_at:
                transaction = self._next(now)
                if transaction is None:
                    break
                self._send(transaction, self._write, now)
        finally:
            for request in late:
                request.fail(errors.WaitedTooLong())

    def _next(self, now: float) -> Transaction | None:
        """The transaction whose turn it is; None when there is none, or all of them are held by late windows."""
        again, self._again = self._again, None
        if again is not None:
            return again
        if not self._late.windows:
            return self._queue.take()
        transaction = self._queue.take(lambda waiting: self._late.forbid_until(waiting, now) is not None)
        if transaction is None and len(self._queue):
            self._held_until = self._late.next_end() or 0.0
        return transaction

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        if not transaction.retries and self._is_turned_down(transaction, now):
            return
        self._current = transaction
        self._sent_at = now
        try:
            transaction.start(self._budget, now)
        except RequestError as error:
            self._current = None
            transaction.fail(error)
            return
        transaction.counts.sent += 1
        if transaction.expects_answer:
            self._await_answer(transaction, now)
        else:
            self._current = None
            transaction.counts.broadcast += 1
            self._quiet_at = transaction.ends_at + max(self.settings.turnaround, self._gap)
            self.busy_seconds += self._quiet_at - now
        try:
            asked = transaction.asked.data
            self._hearing.said(self._framer.encode(transaction.unit, asked), asked)
            if self._echo is not None:
                self._echo.expect(self._hearing.sent)
            write(self._hearing.sent)
        finally:
            if not transaction.expects_answer:
                transaction.end()

    def _is_turned_down(self, transaction: Transaction, now: float) -> bool:
        """Finish a transaction that nobody wants any more, or that must not be sent now that its turn has come."""
        if not transaction.is_wanted:
            transaction.counts.unwanted += len(transaction.requests)
            transaction.end()
            return True
        if not self._resting and not self._echo_suspected:
            return False
        refusal = self._ban(transaction, now)
        if refusal is not None:
            transaction.fail(refusal)
        return refusal is not None

    def _await_answer(self, transaction: Transaction, now: float) -> None:
        self._fails_at = transaction.fails_at
        self._quiet_at = transaction.ends_at + self._gap
        self._hearing.begin(self.settings.timing.mode, now, transaction.limit)
        self._framer.expect(transaction.answers_from, transaction.asked)

    def _hear_idle(self, data: bytes, now: float) -> None:
        """Take bytes that nobody asked for; a frame from a unit that rests ends its rest."""
        self.unasked_bytes += len(data)
        self._hearing.keep_idle(data, now)
        mode = self.settings.timing.mode
        for device in [each for each in self._resting if self._hearing.is_idle_from(each.unit, mode)]:
            self._heard_from(device)

    def _judge(self, current: Transaction, frames: list[Frame], now: float) -> None:
        """Finish the current transaction with the first frame that fits it; others are dropped.

        All frames were received before anything else was sent, so none of them can answer the next request.
        """
        answer = None
        for frame in frames:
            if answer is None and current.accepts(frame):
                answer = frame
            elif frame not in self._hearing.late:
                self._report.foreign(frame, current)
                self._hearing.foreign = True
        if answer is None:
            return
        hearing = self._hearing
        if self._framer.heard_noise or hearing.foreign or hearing.early or hearing.strangers:
            asked = self._listen_back(current, answer, now)
            if asked is not None:
                self._report.other_client(current, asked)
                self._fail(current, errors.AmbiguousResponse(), now)
                return
        current.counts.responses += 1
        self._heard_from(current.device)
        if current.owed:
            self._finish_owed(current, answer, now, current.owed)
        else:
            self._finish(current, answer, now)

    def _listen_back(self, current: Transaction, answer: Frame, now: float) -> Frame | None:
        """Find out what was heard before `answer`; the request of another client to the same unit, if there was one."""
        heard = self._hearing.before(answer, self.settings.timing.mode, self._framer)
        self._notice_echo(current, heard.echo_at)
        current.counts.noise += heard.has_noise
        for frame in heard.responses:
            handed_over = current.answers_from in (None, frame.unit) and current.asked.accepts(frame.pdu)
            if not handed_over and frame not in self._hearing.late:
                self._report.foreign(frame, current)
        asked = (current.unit, answer.unit)
        requests = [frame for frame in heard.requests if frame not in self._hearing.late]
        self._hearing.keep_strangers(requests, now)
        return next((frame for frame in (*requests, *self._hearing.strangers) if frame.unit in asked), None)

    def _notice_echo(self, current: Transaction, echo_at: int) -> None:
        """On a real port, remember that the adapter returns what is sent: a copy of it began at `echo_at`, if not -1.

        Only before the request has left is that a proof, if the response can be a copy too.
        """
        is_response = echo_at >= len(self._hearing.early) and current.asked.accepts(current.asked.data)
        if not self._is_virtual and echo_at >= 0 and not is_response:
            self._report.echo(current, first=not self._echo_suspected)
            self._echo_suspected = True

    def _take_late(self, response: LateResponse, now: float) -> None:
        self._hearing.late.append(response.frame)
        self._report.late_response(response.transaction, now)
        device = response.transaction.device
        self._heard_from(device)
        device.finished(response.transaction, response.frame)

    def _heard_from(self, device: Addressee) -> None:
        if device.breaker.failures and device.breaker.heard():
            self._resting.discard(device)
            self._report.recovered(device)

    def _give_up(self, current: Transaction, now: float) -> None:
        """The limit has run out: send the request again if that may help, else say what was heard instead."""
        for frame in self._framer.conclude():
            if frame not in self._hearing.late:
                self._report.foreign(frame, current)
        heard = self._hearing.instead(self._framer)
        self._notice_echo(current, heard.find(self._hearing.sent))
        is_repeatable = current.asked.function in READING_FUNCTIONS and current.is_wanted
        if heard and is_repeatable and current.retries < self.settings.retries:
            current.owed += not self._hearing.has_begun(current, self.settings.timing.mode, self._framer)
            current.retries += 1
            current.counts.retries += 1
            self.busy_seconds += now - self._sent_at
            self._again, self._current = current, None
            return
        self._lose(current, now)

    def _lose(self, current: Transaction, now: float) -> None:
        """The current transaction has failed."""
        heard = self._hearing.instead(self._framer)
        self._report.given_up(current, now, heard=heard)
        if heard:
            self._hearing.lost(heard, self.settings.timing.mode, now)
        disturbed = bool(heard) and self._late.any_but(current.unit, now)
        if not disturbed and current.device.breaker.failed(current.limit, self._window_end(current, now)):
            self._resting.add(current.device)
            self._report.resting(current.device)
        self._fail(current, errors.BrokenResponse() if heard else errors.ResponseTimeout(), now)

    def _fail(self, current: Transaction, error: RequestError, now: float) -> None:
        self._finish_owed(current, error, now, current.owed + 1)

    def _finish_owed(self, current: Transaction, outcome: Frame | RequestError, now: float, owed: int) -> None:
        """Finish it although so many answers may come late: who could take one for its own waits or fails."""
        self._open_late_window(current, now, owed)
        overdue = self._queue.drop(lambda waiting: self._is_overdue(waiting, now))
        try:
            self._finish(current, outcome, now)
        finally:
            _fail_all(overdue, errors.AnswerOverdue())

    def _open_late_window(self, current: Transaction, now: float, owed: int) -> None:
        self._late.open(current, self._framer, self._window_end(current, now), owed)
        self._framer = self._new_framer()

    def _window_end(self, current: Transaction, now: float) -> float:
        """Until when a late answer is awaited: by default twice the limit, or the device's slowest answer."""
        length = self.settings.late_window
        return now + (max(2 * current.limit, current.device.answer_time.slowest) if length is None else length)

    def _finish(self, transaction: Transaction, outcome: Frame | RequestError, now: float) -> None:
        """The transaction is over. The next request goes out before the answer is sent on."""
        response = outcome if isinstance(outcome, Frame) else None
        self._current = None
        self.busy_seconds += now - self._sent_at
        try:
            transaction.device.finished(transaction, response)
            if self.observer is not None:
                self.observer(transaction, response, now)
            self._go_on(now)
        finally:
            if isinstance(outcome, Frame):
                transaction.respond(outcome.pdu)
            else:
                transaction.device.counts.last_error = outcome.result
                transaction.fail(outcome)

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "idle"
        return f"<Line {self.settings.name} {state} waiting={len(self._queue)}>"


def _earliest(one: float, other: float | None) -> float:
    return one if other is None or one < other else other


def _fail_all(transactions: list[Transaction], error: RequestError) -> None:
    for transaction in transactions:
        transaction.fail(error)
