"""What waits for a line, and what of it may be sent: whose turn it is, unless the time for it has not come.

A request is not sent while its unit rests (`breaker`), while a late answer could be taken for its own (`late`), or when
its answer would be a copy of it on a line that echoes.
"""

from gateway import errors
from gateway.errors import RequestError
from gateway.lines.hearing import Hearing
from gateway.lines.late import WORTH_WAITING, LateResponse, LateWindows
from gateway.lines.queue import WaitingQueue
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.stall import HasArrived, Stall
from gateway.lines.transaction import Addressee, Transaction
from gateway.modbus.frame import Frame, ResponseFramer


class Turns:
    """The waiting requests of one line, its late windows and its resting units.

    `expired`, `given_up`, `put_back` and `clear` are those of its queue, `window_end` is the hearing's.
    """

    def __init__(self, settings: LineSettings, hearing: Hearing, late: LateWindows, report: Report) -> None:
        self._hearing = hearing
        self._report = report
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        self._late = late
        self._stall = Stall(None)
        self._longest_rest = settings.rest
        self._resting: set[Addressee] = set()
        self._held_until = 0.0
        self.expired = self._queue.expired
        self.given_up = self._queue.given_up
        self.put_back = self._queue.put_back
        self.clear = self._queue.clear
        self.window_end = hearing.window_end

    def __len__(self) -> int:
        """How many requests wait."""
        return len(self._queue)

    def late_windows(self, now: float) -> int:
        """How many late answers are awaited."""
        return self._late.count(now)

    def put(self, transaction: Transaction, now: float) -> RequestError | None:
        """Let a transaction wait for its turn; the reason if it need not even wait."""
        refusal = self._ban(transaction, now)
        if refusal is not None:
            return refusal
        if self._late.windows and self._is_overdue(transaction, now):
            return errors.AnswerOverdue()
        refused = self._queue.put(transaction, now)
        if refused is not None:
            self._report.queue_full(refused)
        if refused is transaction:
            return errors.QueueFull()
        self._held_until = 0.0
        if refused is not None:
            refused.fail(errors.QueueFull())
        return None

    def next(self, now: float) -> Transaction | None:
        """Take out the transaction whose turn it is; None if there is none, or late windows hold all of them.

        Nothing is sent on a connection that is to be renewed.
        """
        if self._stall.is_over(now):
            return None
        if not self._late.windows:
            return self._queue.take()
        transaction = self._queue.take(lambda waiting: self._late.forbid_until(waiting, now) is not None)
        if transaction is None and len(self._queue):
            self._held_until = self._late.next_end() or 0.0
        return transaction

    def is_turned_down(self, transaction: Transaction, now: float) -> bool:
        """Finish a transaction that nobody wants any more, or that must not be sent now that its turn has come."""
        if not transaction.is_wanted:
            transaction.fail(errors.Unwanted())
            return True
        refusal = self._ban(transaction, now)
        if refusal is not None:
            transaction.fail(refusal)
        return refusal is not None

    def deadline(self, sends_at: float) -> float | None:
        """When the next one can be sent, on a line that is free at `sends_at`, or has waited too long."""
        alarm = earliest(self.next_alarm(), self._stall.ends_at)
        return earliest(max(sends_at, self._held_until), alarm) if len(self._queue) else alarm

    def next_alarm(self) -> float | None:
        """When the next one has waited too long, or silence may have ended a late answer."""
        if not self._late.windows:
            return self._queue.next_expiry()
        return earliest(self._queue.next_expiry(), self._late.deadline())

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that the line delivers while late answers are awaited; those of them that are late answers."""
        self._held_until = 0.0
        return self._came_late(self._late.received(data, now, damaged=damaged, others=self._hearing.listen()), now)

    def tick(self, now: float) -> None:
        """Let time pass: a silence may have ended a late answer, or a window has ended."""
        if self._late.windows:
            self._came_late(self._late.tick(now), now)
        if self._stall.is_over(now):
            self._await_arrival(now)

    def await_late(self, transaction: Transaction, framer: ResponseFramer, now: float) -> list[Transaction]:
        """The answers that `transaction` is owed may come late; `framer` looks for them.

        Takes out all that could take one for its own and would have to wait too long for it. What waits to be sent
        again waits for its window anyway.
        """
        self._late.open(transaction, framer, self.window_end(transaction, now), transaction.owed)
        transaction.owed = 0
        return self._queue.drop(lambda waiting: not waiting.retries and self._is_overdue(waiting, now))

    def failed(self, transaction: Transaction, heard: bytes, now: float) -> None:
        """No answer has come, but this was heard. If it is another unit's late answer, both may have spoken at once."""
        if not heard:
            self._stall.timed_out(transaction, self.window_end(transaction, now))
        unit = transaction.unit
        if any(frame.unit != unit for frame in self._hearing.late) or self._late.has_begun_in(heard, unit, now):
            return
        device = transaction.device
        window_end = self.window_end(transaction, now)
        if device.breaker.failed(transaction.limit, window_end, self._longest_rest):
            self._resting.add(device)
            self._report.resting(device, now)

    def answered(self, transaction: Transaction) -> None:
        """A valid answer to it has come, in time or late."""
        self._stall.answered(transaction)
        self.heard(transaction.device)

    def heard(self, device: Addressee) -> None:
        """The unit has spoken: its rest is over."""
        if device.breaker.failures and device.breaker.heard():
            self._resting.discard(device)
            self._report.recovered(device)

    def heard_idle(self) -> None:
        """Something has come while nothing was asked, perhaps from a unit that rests."""
        if self._resting:
            spoken = self._hearing.have_spoken({device.unit for device in self._resting})
            for device in [each for each in self._resting if each.unit in spoken]:
                self.heard(device)

    def connected(self, has_arrived: HasArrived | None) -> None:
        """There is a port. A new connection holds nothing back."""
        self._stall = Stall(has_arrived)

    def must_renew(self, now: float) -> bool:
        """Whether the connection may hold back what was asked, so that another one is needed."""
        return self._stall.is_over(now)

    def end_rests(self) -> None:
        """The port was away: whoever failed before may be fine now."""
        for device in self._resting:
            device.breaker.heard()
        self._resting.clear()

    def _ban(self, transaction: Transaction, now: float) -> RequestError | None:
        """Why a transaction must not be sent, even if its turn has come."""
        if self._resting and transaction.device.breaker.rests(now):
            return errors.UnitResting()
        if self._hearing.echo_suspected and transaction.expects_answer:
            asked = transaction.asked
            return errors.EchoSuspected() if asked.accepts(asked.data) else None
        return None

    def _await_arrival(self, now: float) -> None:
        """Requests whose windows have ended may only have arrived at the server since: their limits begin now."""
        for question in self._stall.take_underway(now):
            framer = self._hearing.framer_for(question.answers_from, question.asked)
            ends_at = self.window_end(question, now + question.limit)
            self._late.open(question, framer, ends_at, 1)
            self._stall.timed_out(question, ends_at)

    def _is_overdue(self, transaction: Transaction, now: float) -> bool:
        until = self._late.forbid_until(transaction, now)
        return until is not None and until - now > WORTH_WAITING

    def _came_late(self, responses: list[LateResponse], now: float) -> list[Frame]:
        for question, frame in responses:
            if isinstance(question, Transaction):
                self._report.late_response(question, now)
                self.answered(question)
                question.device.finished(question, frame)
        return [frame for _, frame in responses]


def earliest(one: float | None, other: float | None) -> float | None:
    """The earlier of two times, of which each may be None."""
    if one is None or other is None:
        return other if one is None else one
    return min(one, other)
