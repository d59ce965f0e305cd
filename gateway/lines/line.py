"""The transaction machine of one line: one request at a time, a silence before it, a limit after it, only its response.

| state     | what happens                            | next      | what is done                                      |
|-----------|-----------------------------------------|-----------|---------------------------------------------------|
| down      | `port_up`                               | idle      |                                                   |
| idle      | a turn, and the line is quiet           | awaiting  | the request is written                            |
| idle      | the turn of a broadcast                 | idle      | it is written; the line is quiet for a while    |
| awaiting  | the answer                              | idle      | the client gets it                                |
| awaiting  | the limit, a damaged or doubted answer  | idle      | 0B, or the read waits for its second sending; a   |
|           |                                         |           | late window opens for what is owed                |
| awaiting  | the same, if a second sending may help  | repeating |                                                   |
| repeating | the line is quiet                       | awaiting  | the request is written again                      |
| repeating | bytes come: they may be the answer      | idle      | 0B                                                |
| idle      | `renew`: this connection may hold back  | renewing  | what waits goes on waiting                        |
| renewing  | `port_up`                               | idle      |                                                   |
| renewing  | `RENEWAL` seconds pass                  | down      | 0A for all that waits                             |
| any other | `port_down`                             | down      | 0B for what was sent, 0A for all that waits       |
| awaiting  | `finish`                                | last      | 0A for all that waits                             |
| any other | `finish`                                | down      | the same, and 0B for what was to be repeated      |
| last      | the answer, the limit                   | down      | as from awaiting                                  |

Which request goes next is the matter of `scheduler`, what the bytes from the line mean that of `receiver`.

The machine knows no clock and no descriptor: bytes, time and requests are its arguments, and `deadline` says when it
wants to be called again. It finishes its own state before it calls a request's origin, which may submit the next
request at once.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import inf, nextafter
from typing import Final, Literal

from gateway import errors
from gateway.errors import RequestError
from gateway.events import Emit
from gateway.lines.echo import EchoDetector
from gateway.lines.late import LateWindows, Overdue
from gateway.lines.receiver import NOTHING, Outcome, Receiver, Verdict
from gateway.lines.report import Report
from gateway.lines.scheduler import Scheduler, earliest
from gateway.lines.settings import LineSettings
from gateway.lines.stall import HasArrived
from gateway.lines.transaction import Transaction
from gateway.modbus.frame import Frame
from gateway.timing.budget import Budget
from gateway.timing.measured import Phases, TimeSpent

#: Silence after a device has answered that it changes its rate, in seconds: time for it, and for our own port.
RATE_CHANGE_PAUSE: Final = 0.1
#: How long requests wait for a connection that is made anew, in seconds.
RENEWAL: Final = 1.0

#: Is shown each transaction that was on the line, its answer or None, and when that was known.
Observer = Callable[[Transaction, Frame | None, float], None]


#: See the table above.
State = Literal["down", "idle", "awaiting", "repeating", "renewing", "last"]


class Line:
    """One line and its transactions. `observer`, if there is one, is shown each of them."""

    def __init__(self, settings: LineSettings, emit: Emit) -> None:
        self.settings = settings
        #: Bytes that came while nothing was asked, and what the line's time went into.
        self.unasked_bytes = 0
        self.spent = TimeSpent()
        self.observer: Observer | None = None
        self._report = Report(settings.name, settings.source, emit)
        self._windows = LateWindows(settings.late_window)
        echo = EchoDetector(self._report, is_configured=settings.echo)
        self._receiver = Receiver(settings, self._windows, echo, self._report)
        self._scheduler = Scheduler(settings, self._windows, echo, self._report)
        self._write: Callable[[bytes], None] | None = None
        self._has_arrived: HasArrived | None = None
        self._is_virtual = True
        self._state: State = "down"
        #: What is awaited or to be repeated, and what came instead of its answer when it was sent before.
        self._current: Transaction | None = None
        self._instead = NOTHING
        self._quiet_at = 0.0
        self._renewed_until = 0.0
        self._tune(latency=0.0)

    @property
    def waiting(self) -> int:
        """How many requests wait."""
        return len(self._scheduler)

    def late_windows(self, now: float) -> int:
        """How many late answers are awaited."""
        return self._windows.count(now)

    def phases(self, now: float) -> Phases:
        """What the line's time has gone into, also the time for what is awaited `now`."""
        current = self._current
        if current is None or not self._is_awaiting:
            return self.spent.phases()
        ends_at = min(current.ends_at, now)
        return self.spent.phases(ends_at - current.sent_at, now - ends_at)

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
        self._scheduler.connected(has_arrived)
        if self._state != "renewing":
            self._scheduler.end_rests()
        self._state = "idle"

    def port_down(self, now: float) -> None:
        """The port has gone: what was on the line may have been acted on (0B), what waited was not sent (0A)."""
        if self._state == "renewing" and now < self._renewed_until:
            return
        self._disconnect("down")
        waiting = self._scheduler.clear()
        try:
            if self._current is not None:
                self._finish(self._current, errors.LineLost(), now)
        finally:
            _fail_waiting(waiting)

    def must_renew(self, now: float) -> bool:
        """Whether the line goes on with a new connection only: this one may hold back what was asked."""
        return not self.is_busy and self._scheduler.must_renew(now)

    def renew(self, now: float) -> None:
        """The connection is closed and made anew: what waits goes on waiting, for RENEWAL at most."""
        self._disconnect("renewing")
        self._renewed_until = now + RENEWAL

    @property
    def is_renewing(self) -> bool:
        """Whether what waits goes on waiting for a new connection."""
        return self._state == "renewing"

    @property
    def is_busy(self) -> bool:
        """Whether a request is on the line, or about to be sent again."""
        return self._current is not None

    def is_quiet(self, now: float) -> bool:
        """Whether the line is free and its silence is over, so that a request would leave at once."""
        return self._state != "awaiting" and now >= self._quiet_at

    def finish(self, now: float) -> None:
        """Take no more requests: what waits is not sent any more (0A), what is on the line may be answered."""
        is_repeating = self._state == "repeating"
        self._disconnect("down" if self._current is None else "last")
        waiting = self._scheduler.clear()
        try:
            if is_repeating and self._current is not None:
                self._lose(self._current, now)
        finally:
            _fail_waiting(waiting)

    def overdue(self, now: float, patience: float) -> list[Overdue]:
        """What may still come, for a line that follows on the same port: late answers, and those to other clients.

        Nobody is answered later than `patience` seconds after the request.
        """
        others = [
            Overdue(request.frame.unit, request.frame.unit, request.asked.data, 1, request.at + patience)
            for request in self._receiver.foreign_requests()
            if request.at + patience > now
        ]
        return self._windows.overdue(now) + others

    def await_overdue(self, answers: Iterable[Overdue]) -> None:
        """Await the late answers to what an earlier line on the port has asked."""
        for each in answers:
            expected = self._receiver.expected(each.answers_from, each.asked)
            self._windows.open(each, expected, each.ends_at, each.owed)

    def change_rate(self, baud: int, now: float) -> None:
        """The devices, and the port with them, change to another rate: nothing is sent for a moment.

        A transaction that is on the line comes to its end first.
        """
        self.settings = replace(self.settings, timing=replace(self.settings.timing, baud=baud))
        if self._current is None:
            self._follow_rate(now)

    def submit(self, transaction: Transaction, now: float) -> None:
        """Take over a transaction: it is sent when its turn comes and the line is quiet, or it fails."""
        is_down = self._state in ("down", "last")
        rejection = errors.LineDown() if is_down else self._scheduler.put(transaction, now)
        if rejection is not None:
            transaction.fail(rejection)
        elif not self.is_busy:
            self._go_on(now)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> None:
        """Take bytes that became readable at `now`. No frame with all of `damaged` ones in it is an answer."""
        if self._state == "repeating" and self._current is not None:
            self._stop_repeating(self._current, now)
        current = self._current
        if current is None:
            self._quiet_at = max(self._quiet_at, now + self._gap)
            self._receiver.received(data, now, damaged=damaged)
            self._heard_idle(len(data), now)
            return
        early = not self._is_virtual and now < current.ends_at and not self.settings.echo
        if not early:
            self._quiet_at = now + self._gap
            early = self._has_arrived is not None and not self._has_arrived()
        outcome = self._receiver.received(data, now, damaged=damaged, early=early)
        self._tell_late(now)
        if outcome is not None:
            self._take(current, outcome, now)

    def deadline(self) -> float | None:
        """When `tick` wants to be called, or None while there is nothing to wait for."""
        if self._current is None and self._state != "renewing":
            alarm = self._scheduler.deadline(self._quiet_at)
        else:
            alarm = earliest(self._next_step(), self._scheduler.next_expiry())
        return earliest(alarm, self._receiver.late_deadline()) if self._windows.windows else alarm

    def look_at(self, now: float) -> float | None:
        """When to look at the port again: nothing that comes before decides anything. None: at the next byte."""
        return None if self._windows.windows else self._receiver.look_at(now)

    def tick(self, now: float) -> None:
        """Let time pass: a silence may have ended a response, a limit may have run out, the line may be quiet again."""
        outcome = self._receiver.tick(now)
        self._tell_late(now)
        for transaction in self._scheduler.take_underway(now):
            expected = self._receiver.expected(transaction.answers_from, transaction.asked)
            self._scheduler.await_arrived(transaction, expected, now)
        if self._state == "renewing" and now >= self._renewed_until:
            self.port_down(now)
        current = self._current
        if current is not None and outcome is not None:
            self._take(current, outcome, now)
        elif current is not None and self._is_awaiting and now >= self._next_step():
            self._give_up(current, now)
        self._go_on(now)

    @property
    def _is_awaiting(self) -> bool:
        return self._state in ("awaiting", "last")

    def _tune(self, latency: float) -> None:
        """Work out what follows from the line's timing and its port's latency."""
        self._budget = Budget(self.settings.timing, latency)
        self._gap = self.settings.silence_before_request
        self.spent.tune(self.settings.timing)
        self._receiver.tune(self._budget, self.settings.frame_end + latency, virtual=self._is_virtual)

    def _disconnect(self, state: State) -> None:
        self._state = state
        self._write = None
        self._scheduler.connected(None)

    def _follow_rate(self, now: float) -> None:
        self._tune(self._budget.latency)
        self._quiet_at = max(self._quiet_at, now + RATE_CHANGE_PAUSE)

    def _next_step(self) -> float:
        """When the state ends if nothing happens. A response of unknown size that has begun may come to its end."""
        current = self._current
        if current is None:
            return self._renewed_until
        if self._state == "repeating":
            return self._quiet_at
        silence, fails_at = self._receiver.deadline(), current.fails_at
        if silence is not None:
            return silence if silence <= fails_at else min(silence, fails_at + self.settings.timing.longest_frame)
        damaged_at = self._receiver.damaged_at
        return fails_at if damaged_at is None else min(damaged_at, fails_at)

    def _go_on(self, now: float) -> None:
        """Send the next request if the line is free and quiet, and refuse those that have waited too long."""
        late = self._scheduler.expired(now)
        given_up = self._scheduler.given_up(now)
        try:
            while self._write is not None and self._state != "awaiting" and now >= self._quiet_at:
                transaction = self._current or self._scheduler.next(now)
                if transaction is None:
                    break
                rejection = None if transaction is self._current else self._rejection(transaction, now)
                if rejection is None:
                    self._send(transaction, self._write, now)
                else:
                    transaction.fail(rejection)
        finally:
            for request in late:
                request.fail(errors.WaitedTooLong())
            _fail_all(given_up, errors.ResponseTimeout())

    def _rejection(self, transaction: Transaction, now: float) -> RequestError | None:
        """Why a transaction is not sent, now that its turn has come."""
        return self._scheduler.rejection(transaction, now) if transaction.is_wanted else errors.Unwanted()

    def _send(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        self._current, self._state = transaction, "awaiting"
        try:
            transaction.start(self._budget, now)
        except RequestError as error:
            self._current, self._state = None, "idle"
            transaction.fail(error)
            return
        transaction.sent(now)
        transaction.owed += not transaction.is_broadcast
        if transaction.expects_answer:
            self._quiet_at = transaction.ends_at + self._gap
            write(self._receiver.begin(transaction, now))
        else:
            self._send_unanswered(transaction, write, now)

    def _send_unanswered(self, transaction: Transaction, write: Callable[[bytes], None], now: float) -> None:
        """Send what nobody answers, and leave the devices time to act."""
        self._current, self._state = None, "idle"
        self._quiet_at = transaction.ends_at + max(self.settings.turnaround, self._gap)
        self.spent.add(now, transaction.ends_at, transaction.ends_at, 0, self._quiet_at)
        overdue: list[Transaction] = []
        try:
            write(self._receiver.begin(transaction, now))
            if transaction.owed:  # a unit that knows no listen-only mode answers all the same
                overdue = self._scheduler.await_late(transaction, now)
        finally:
            transaction.finish_unanswered()
            _fail_all(overdue, errors.AnswerOverdue())

    def _heard_idle(self, size: int, now: float) -> None:
        if not self._receiver.came_late:
            self.unasked_bytes += size
        self._tell_late(now)
        resting = self._scheduler.resting
        if resting:
            self._scheduler.spoken(self._receiver.spoken(resting))
        self._go_on(now)

    def _tell_late(self, now: float) -> None:
        """Tell of the answers to older requests that have come."""
        late, self._receiver.came_late = self._receiver.came_late, []
        for question, frame in late:
            if isinstance(question, Transaction):
                self._report.late_response(question, now)
                self._scheduler.answered(question)
                question.device.finished(question, frame)

    def _take(self, current: Transaction, outcome: Outcome, now: float) -> None:
        """The answer has come, or one that is doubted."""
        if isinstance(outcome, Frame):
            current.answered(now)
            current.owed -= 1
            self._scheduler.answered(current)
        else:  # its own answer comes next: nobody speaks into it
            self._quiet_at = max(self._quiet_at, current.fails_at)
        self._finish(current, outcome, now)

    def _give_up(self, current: Transaction, now: float) -> None:
        """No answer has come: send the request again if that may help, else say what was heard instead.

        After silence it may help once the late window is over, and likewise if another client waits for an answer.
        """
        instead = self._instead = self._receiver.conclude()
        self._tell_late(now)
        current.owed -= self._receiver.has_answered_badly(now)
        if current.owed:  # else the unit has answered, only not well
            self._failed(current, instead.text, now)
        at_once = instead.verdict is Verdict.BROKEN and not self._receiver.may_be_others(current)
        if not self._may_repeat(current, now, now if at_once else self._windows.end_of(current, now)):
            self._lose(current, now)
        elif at_once:
            current.retries += 1
            self._spend(current, 0, now)
            self._state = "repeating"
        else:
            self._finish(current, None, now)

    def _failed(self, current: Transaction, text: bytes, now: float) -> None:
        """No answer has come, but this was heard. If it is another unit's late answer, both may have spoken at once."""
        if not text:
            self._scheduler.stalled(current, now)
        if not self._receiver.may_have_collided(current.unit, text, now):
            self._scheduler.failed(current, now)

    def _may_repeat(self, current: Transaction, now: float, at: float) -> bool:
        """Whether the request may be sent once more, `at` the earliest."""
        if current.retries >= self.settings.retries or not current.asked.only_reads:
            return False
        if self._write is None or not current.is_wanted or current.device.breaker.is_resting(now):
            return False
        if not current.retries:
            within = self.settings.retry_within
            if within is None:
                within = 2 * (self._windows.end_of(current, current.fails_at) - current.ends_at)
            current.gives_up_at = current.sent_at + within - (current.fails_at - current.sent_at)
        return at <= current.gives_up_at

    def _stop_repeating(self, current: Transaction, now: float) -> None:
        """The line is not quiet: what comes may be the answer, so nothing is sent again, nor anything else now."""
        current.owed = max(1, current.owed)
        self._quiet_at = max(self._quiet_at, nextafter(now, inf))
        self._lose(current, now)

    def _lose(self, current: Transaction, now: float) -> None:
        """The transaction has failed."""
        verdict, text = self._instead
        self._report.given_up(current, now, heard=text, is_echo=verdict is Verdict.ECHO)
        self._finish(current, errors.BrokenResponse() if text else errors.ResponseTimeout(), now)

    def _finish(self, current: Transaction, outcome: Frame | RequestError | None, now: float) -> None:
        """The transaction is over; without an outcome until it is sent again.

        While an answer to it may come late, who could take that for its own waits or fails.
        """
        self._receiver.stop()
        self._tell_late(now)
        overdue = self._scheduler.await_late(current, now) if current.owed else []
        if outcome is None:
            self._scheduler.put_back(current.again())
        response = outcome if isinstance(outcome, Frame) else None
        if self._state != "repeating":
            self._spend(current, 0 if response is None else len(response.pdu), now)
        self._current = None
        self._state = "down" if self._write is None else "idle"
        if self._budget.line is not self.settings.timing:
            self._follow_rate(now)
        try:
            current.device.finished(current, response)
            if self.observer is not None:
                self.observer(current, response, now)
            self._go_on(now)
        finally:
            _answer(current, outcome, now)
            _fail_all(overdue, errors.AnswerOverdue())

    def _spend(self, current: Transaction, response: int, now: float) -> None:
        """The line was given to this until `now`; the PDU of its response has so many bytes."""
        self.spent.add(current.sent_at, current.ends_at, now, response, self._quiet_at)

    def __repr__(self) -> str:
        current = f" {self._current!r}" if self._current else ""
        return f"<Line {self.settings.name} {self._state}{current} waiting={self.waiting}>"


def _answer(transaction: Transaction, outcome: Frame | RequestError | None, now: float) -> None:
    if isinstance(outcome, RequestError):
        transaction.lose(outcome, now)
    elif outcome is not None:
        transaction.respond(outcome.pdu, now)


def _fail_waiting(transactions: list[Transaction]) -> None:
    """The port has gone, so they are not sent; those that wait to be sent again have been."""
    for transaction in transactions:
        transaction.fail(errors.LineLost() if transaction.retries else errors.LineDown())


def _fail_all(transactions: list[Transaction], error: RequestError) -> None:
    for transaction in transactions:
        transaction.fail(error)
