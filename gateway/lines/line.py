"""The transaction machine of one line: one request at a time, a silence before it, a limit after it, only its response.

    down ──port_up──▶ idle ──submit──▶ (quiet long enough?) ──write──▶ awaiting ──response, limit──▶ idle
                       ▲                                        └─broadcast──▶ turnaround ─────────────┘

Which request goes next is the matter of `turns`, what the bytes from the line mean that of `hearing`.

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.hearing import Hearing, Outcome
from gateway.lines.late import LateWindows, Overdue
from gateway.lines.overheard import Verdict
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.stall import HasArrived
from gateway.lines.transaction import Transaction
from gateway.lines.turns import Turns, earliest
from gateway.modbus.frame import Frame
from gateway.timing.budget import Budget

#: Silence after a device has answered that it changes its rate, in seconds: time for it, and for our own port.
RATE_CHANGE_PAUSE: Final = 0.1
#: How long requests wait for a connection that is made anew, in seconds.
RENEWAL: Final = 1.0

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
        self._windows = LateWindows(settings.timing.mode)
        self._hearing = Hearing(settings, self._windows, self._report)
        self._turns = Turns(settings, self._hearing, self._windows, self._report)
        self._write: Callable[[bytes], None] | None = None
        self._has_arrived: HasArrived | None = None
        self._renewed_until = 0.0
        self._is_virtual = True
        self._current: Transaction | None = None
        self._again: Transaction | None = None
        self._sent_at = 0.0
        self._deaf_until = 0.0
        self._fails_at = 0.0
        self._quiet_at = 0.0
        self._rate_has_changed = False
        self._tune(latency=0.0)

    @property
    def waiting(self) -> int:
        """How many requests wait."""
        return len(self._turns)

    def late_windows(self, now: float) -> int:
        """How many late answers are awaited."""
        return self._turns.late_windows(now)

    def port_up(
        self,
        write: Callable[[bytes], None],
        latency: float,
        now: float,
        *,
        virtual: bool = True,
        has_arrived: HasArrived | None = None,
    ) -> None:
        """The port is open: requests go out through `write`.

        `latency` is what it may add to an answer, in seconds. A `virtual` one carries bytes at once: an answer can come
        before its request would have left a real line. A connection tells whether all of it `has_arrived`.
        """
        self._is_virtual = virtual
        self._has_arrived = has_arrived
        self._tune(latency)
        self._write = write
        self._quiet_at = now + self._gap
        self._turns.connected(has_arrived)
        if now >= self._renewed_until:
            self._turns.end_rests()
        self._renewed_until = 0.0

    def port_down(self, now: float) -> None:
        """The port has gone: what was on the line may have been acted on (0B), what waited was not sent (0A)."""
        if now < self._renewed_until:
            return
        self._disconnect()
        waiting = self._turns.clear()
        lost, self._again = self._current or self._again, None
        try:
            if lost is not None:
                self._finish(lost, errors.LineLost(), now)
        finally:
            _fail_waiting(waiting)

    def must_renew(self, now: float) -> bool:
        """Whether the line goes on with a new connection only: this one may hold back what was asked."""
        return not self.is_busy and self._turns.must_renew(now)

    def renew(self, now: float) -> None:
        """The connection is closed and made anew: what waits goes on waiting, for RENEWAL at most."""
        self._disconnect()
        self._renewed_until = now + RENEWAL

    @property
    def is_renewing(self) -> bool:
        """Whether what waits goes on waiting for a new connection."""
        return self._renewed_until > 0.0

    @property
    def is_busy(self) -> bool:
        """Whether a request is on the line."""
        return self._current is not None or self._again is not None

    def is_quiet(self, now: float) -> bool:
        """Whether the line is free and its silence is over, so that a request would leave at once."""
        return self._current is None and now >= self._quiet_at

    def finish(self, now: float) -> None:
        """Take no more requests: what waits is not sent any more (0A), what is on the line may be answered."""
        self._disconnect()
        self._renewed_until = 0.0
        waiting = self._turns.clear()
        again, self._again = self._again, None
        try:
            if again is not None:
                self._lose(again, now)
        finally:
            _fail_waiting(waiting)

    def overdue(self, now: float, patience: float) -> list[Overdue]:
        """What may still come, for a line that follows on the same port: late answers, and those to other clients.

        Nobody is answered later than `patience` seconds after it has asked.
        """
        others = [
            Overdue(frame.unit, frame.unit, asked.data, 1, at + patience)
            for at, frame, asked in self._hearing.unanswered()
            if at + patience > now
        ]
        return self._windows.overdue(now) + others

    def await_overdue(self, answers: Iterable[Overdue]) -> None:
        """Await the late answers to what an earlier line on the port has asked."""
        for each in answers:
            self._windows.open(each, self._hearing.framer_for(each.answers_from, each.asked), each.ends_at, each.owed)

    def change_rate(self, baud: int, now: float) -> None:
        """The devices, and the port with them, change to another rate: nothing is sent for a moment.

        A transaction that is on the line comes to its end first.
        """
        self.settings = replace(self.settings, timing=replace(self.settings.timing, baud=baud))
        self._rate_has_changed = True
        if self._current is None:
            self._follow_rate(now)

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when its turn comes and the line is quiet, or it fails."""
        is_down = self._write is None and now >= self._renewed_until
        refusal = errors.LineDown() if is_down else self._turns.put(transaction, now)
        if refusal is not None:
            transaction.fail(refusal)
        elif not self.is_busy:
            self._go_on(now)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes that became readable at `now`. No frame with all of `damaged` ones in it is an answer."""
        if self._current is not None and self._has_arrived is not None and not self._has_arrived():
            self._deaf_until = self._hearing.deafen(now)
        if self._again is not None:  # the line is not quiet: what comes may be the answer, so nothing is sent again
            given_up, self._again = self._again, None
            given_up.owed = max(1, given_up.owed)
            self._quiet_at = max(self._quiet_at, now + self._gap)
            self._lose(given_up, now)
        self._hearing.hear(data, now)
        late = self._turns.received(data, now, damaged=damaged) if self._windows.windows else []
        if self._current is None:
            self._quiet_at = max(self._quiet_at, now + self._gap)
            self._received_idle(data, now, is_late=bool(late))
            self._go_on(now)
            return
        if late:
            self._hearing.late += late
        if now < self._deaf_until:
            self._hearing.received_early(data)
            return
        self._quiet_at = now + self._gap
        self._take(self._current, self._hearing.received(data, now, damaged=damaged), now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        if self._current is not None:
            return earliest(self._answer_deadline(), self._turns.next_alarm())
        if self._again is not None:
            return earliest(self._quiet_at, self._turns.next_alarm())
        if self._renewed_until:
            return earliest(self._renewed_until, self._turns.next_alarm())
        return self._turns.deadline(self._quiet_at)

    def look_at(self, now: float) -> float | None:
        """When to look at the port again: nothing that comes before decides anything. None: at the next byte."""
        if self._windows.windows:
            return None
        return self._hearing.look_at_idle(now) if self._current is None else self._hearing.look_at(now)

    def tick(self, now: float) -> None:
        """Let time pass: a silence may have ended a response, a limit may have run out, the line may be quiet again."""
        self._turns.tick(now)
        if self._renewed_until and now >= self._renewed_until:
            self._renewed_until = 0.0
            self.port_down(now)
        if self._current is not None:
            self._take(self._current, self._hearing.tick(now), now)
        if self._current is not None and now >= self._answer_deadline():
            self._give_up(self._current, now)
        self._go_on(now)

    def _tune(self, latency: float) -> None:
        """Work out what follows from the line's timing and its port's latency."""
        self._budget = Budget(self.settings.timing, latency)
        self._gap = self.settings.silence_before_request
        self._is_deaf_while_sending = not self._is_virtual and not self.settings.echo
        self._hearing.tune(self._budget, self.settings.frame_end + latency, virtual=self._is_virtual)

    def _disconnect(self) -> None:
        self._write = None
        self._turns.connected(None)

    def _follow_rate(self, now: float) -> None:
        self._rate_has_changed = False
        self._tune(self._budget.latency)
        self._quiet_at = max(self._quiet_at, now + RATE_CHANGE_PAUSE)

    def _answer_deadline(self) -> float:
        """When the current transaction has failed. A response of unknown size that has begun may come to its end."""
        silence = self._hearing.deadline()
        if silence is None:
            damaged_at = self._hearing.damaged_at
            return self._fails_at if damaged_at is None else min(damaged_at, self._fails_at)
        if silence <= self._fails_at:
            return silence
        return min(silence, self._fails_at + self.settings.timing.longest_frame)

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and refuse those that have waited too long."""
        late = self._turns.expired(now)
        given_up = self._turns.given_up(now)
        try:
            while self._current is None and self._write is not None and now >= self._quiet_at:
                again, self._again = self._again, None
                transaction = again or self._turns.next(now)
                if transaction is None:
                    break
                if again or not self._turns.is_turned_down(transaction, now):
                    self._send(transaction, self._write, now)
        finally:
            for request in late:
                request.fail(errors.WaitedTooLong())
            _fail_all(given_up, errors.ResponseTimeout())

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        self._current = transaction
        try:
            transaction.start(self._budget, now)
        except RequestError as error:
            self._current = None
            transaction.fail(error)
            return
        transaction.counts.sent += 1
        transaction.counts.retries += transaction.retries > 0
        transaction.owed += not transaction.is_broadcast
        self._sent_at = now
        if not transaction.expects_answer:
            self._send_unanswered(transaction, write, now)
            return
        self._fails_at = transaction.fails_at
        self._quiet_at = transaction.ends_at + self._gap
        self._deaf_until = transaction.ends_at if self._is_deaf_while_sending else 0.0
        write(self._hearing.begin(transaction, now, self._deaf_until))

    def _send_unanswered(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        """Send what nobody answers, and leave the devices time to act."""
        self._current = None
        self._quiet_at = transaction.ends_at + max(self.settings.turnaround, self._gap)
        self.busy_seconds += self._quiet_at - now
        overdue: list[Transaction] = []
        if transaction.owed:  # a unit that knows no listen-only mode answers all the same
            framer = self._hearing.framer_for(transaction.answers_from, transaction.asked)
            overdue = self._turns.await_late(transaction, framer, now)
        try:
            write(self._hearing.begin(transaction, now, 0.0))
        finally:
            transaction.finish_unanswered()
            _fail_all(overdue, errors.AnswerOverdue())

    def _received_idle(self, data: bytes, now: float, *, is_late: bool) -> None:
        if not is_late:
            self.unasked_bytes += len(data)
        self._hearing.received_idle(data, now)
        self._turns.heard_idle()

    def _take(self, current: Transaction, outcome: Outcome, now: float) -> None:
        """Finish the current transaction, if there is an outcome."""
        if outcome is None:
            return
        if isinstance(outcome, RequestError):
            self._quiet_at = max(self._quiet_at, current.fails_at)  # its own answer comes next: nobody speaks into it
        else:
            current.counts.responses += 1
            current.owed -= 1
            self._turns.answered(current)
        self._finish(current, outcome, now)

    def _give_up(self, current: Transaction, now: float) -> None:
        """No answer has come: send the request again if that may help, else say what was heard instead.

        After silence it may help once the late window is over, and likewise if another client waits for an answer.
        """
        self._hearing.conclude()
        current.owed -= self._hearing.has_answered(now)
        if current.owed:  # else the unit has answered, only not well
            self._turns.failed(current, self._hearing.instead(), now)
        at_once = self._hearing.verdict is Verdict.BROKEN and not self._hearing.may_be_others()
        if not self._may_repeat(current, now, now if at_once else self._turns.window_end(current, now)):
            self._lose(current, now)
            return
        if at_once:
            current.retries += 1
            self.busy_seconds += now - self._sent_at
            self._again, self._current = current, None
        else:
            self._finish(current, None, now)

    def _may_repeat(self, current: Transaction, now: float, at: float) -> bool:
        """Whether the request may be sent once more, `at` the earliest."""
        if current.retries >= self.settings.retries or not current.asked.only_reads:
            return False
        if self._write is None or not current.is_wanted or current.device.breaker.rests(now):
            return False
        if not current.retries:
            within = self.settings.retry_within
            if within is None:
                within = 2 * (self._turns.window_end(current, current.fails_at) - current.ends_at)
            current.gives_up_at = self._sent_at + within - (current.fails_at - self._sent_at)
        return at <= current.gives_up_at

    def _lose(self, current: Transaction, now: float) -> None:
        """The transaction has failed."""
        heard = self._hearing.instead()
        self._report.given_up(current, now, heard=heard, is_echo=self._hearing.verdict is Verdict.ECHO)
        self._finish(current, errors.BrokenResponse() if heard else errors.ResponseTimeout(), now)

    def _finish(self, current: Transaction, outcome: Frame | RequestError | None, now: float) -> None:
        """The transaction is over; without an outcome until it is sent again.

        While an answer to it may come late, who could take that for its own waits or fails.
        """
        overdue = self._turns.await_late(current, self._hearing.hand_over(), now) if current.owed else []
        if outcome is None:
            self._turns.put_back(current.again())
        response = outcome if isinstance(outcome, Frame) else None
        if self._current is not None:
            self.busy_seconds += now - self._sent_at
        self._current = None
        if self._rate_has_changed:
            self._follow_rate(now)
        try:
            current.device.finished(current, response)
            if self.observer is not None:
                self.observer(current, response, now)
            self._go_on(now)
        finally:
            _answer(current, outcome)
            _fail_all(overdue, errors.AnswerOverdue())

    def __repr__(self) -> str:
        state = "down" if self._write is None else repr(self._current) if self._current else "idle"
        return f"<Line {self.settings.name} {state} waiting={self.waiting}>"


def _answer(transaction: Transaction, outcome: Frame | RequestError | None) -> None:
    if isinstance(outcome, RequestError):
        transaction.device.counts.last_error = outcome.result
        transaction.fail(outcome)
    elif outcome is not None:
        transaction.respond(outcome.pdu)


def _fail_waiting(transactions: list[Transaction]) -> None:
    """The port has gone, so they are not sent; those that wait to be sent again have been."""
    for transaction in transactions:
        transaction.fail(errors.LineLost() if transaction.retries else errors.LineDown())


def _fail_all(transactions: list[Transaction], error: RequestError) -> None:
    for transaction in transactions:
        transaction.fail(error)
