"""What waits for a line, and what of it may be sent: whose turn it is, unless the time for it has not come.

A request is not sent while its unit rests (`breaker`), while a late answer could be taken for its own (`late`), while
its connection may hold back what was asked before (`stall`), or when its answer would be a copy of it on a line that
echoes (`echo`). The scheduler sees no bytes.
"""

from gateway import errors
from gateway.errors import RequestError
from gateway.lines.echo import EchoDetector
from gateway.lines.late import WORTH_WAITING, LateWindows
from gateway.lines.queue import WaitingQueue
from gateway.lines.report import Report
from gateway.lines.settings import LineSettings
from gateway.lines.stall import HasArrived, Stall
from gateway.lines.transaction import Destination, Transaction
from gateway.modbus.scan import Expected


class Scheduler:
    """The waiting requests of one line, and the units that rest.

    `expired`, `given_up`, `put_back` and `clear` are those of its queue.
    """

    def __init__(self, settings: LineSettings, windows: LateWindows, echo: EchoDetector, report: Report) -> None:
        self._windows = windows
        self._echo = echo
        self._report = report
        self._queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        self._stall = Stall(None)
        self._longest_rest = settings.rest
        self._resting: set[Destination] = set()
        self._held_until = 0.0
        self.expired = self._queue.expired
        self.given_up = self._queue.given_up
        self.put_back = self._queue.put_back
        self.clear = self._queue.clear

    def __len__(self) -> int:
        """How many requests wait."""
        return len(self._queue)

    def put(self, transaction: Transaction, now: float) -> RequestError | None:
        """Let a transaction wait for its turn; the reason if it need not even wait."""
        rejection = self.rejection(transaction, now)
        if rejection is not None:
            return rejection
        if self._windows.windows and self._is_overdue(transaction, now):
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
        if not self._windows.windows:
            return self._queue.take()
        transaction = self._queue.take(lambda waiting: self._windows.forbid_until(waiting, now) is not None)
        if transaction is None and len(self._queue):
            self._held_until = self._windows.next_end() or 0.0
        return transaction

    def rejection(self, transaction: Transaction, now: float) -> RequestError | None:
        """Why a transaction must not be sent, even if its turn has come."""
        if self._resting and transaction.device.breaker.is_resting(now):
            return errors.UnitResting()
        if self._echo.is_suspected and transaction.expects_answer:
            asked = transaction.asked
            return errors.EchoSuspected() if asked.accepts(asked.data) else None
        return None

    def deadline(self, sends_at: float) -> float | None:
        """When the next one can be sent, on a line that is free at `sends_at`, or has waited too long."""
        alarm = earliest(self._queue.next_expiry(), self._stall.ends_at)
        return earliest(max(sends_at, self._held_until), alarm) if len(self._queue) else alarm

    def next_expiry(self) -> float | None:
        """When the next one has waited too long."""
        return self._queue.next_expiry()

    def await_late(self, transaction: Transaction, now: float) -> list[Transaction]:
        """The answers that `transaction` is owed may come late.

        Takes out all that could take one for its own and would have to wait too long for it. What waits to be sent
        again waits for its window anyway.
        """
        self._windows.open(transaction, transaction.expected, self._windows.end_of(transaction, now), transaction.owed)
        transaction.owed = 0
        return self._queue.drop(lambda waiting: not waiting.retries and self._is_overdue(waiting, now))

    def failed(self, transaction: Transaction, now: float) -> None:
        """The unit has not answered."""
        device = transaction.device
        window_end = self._windows.end_of(transaction, now)
        if device.breaker.record_failure(transaction.limit, window_end, self._longest_rest):
            self._resting.add(device)
            self._report.resting(device, now)

    def stalled(self, transaction: Transaction, now: float) -> None:
        """Nothing at all has come since it was sent."""
        self._stall.timed_out(transaction, self._windows.end_of(transaction, now))

    def answered(self, transaction: Transaction) -> None:
        """A valid answer to it has come, in time or late."""
        self._held_until = 0.0
        self._stall.answered(transaction)
        self._recover(transaction.device)

    @property
    def resting(self) -> set[int]:
        """The units that rest."""
        return {device.unit for device in self._resting}

    def spoken(self, units: set[int]) -> None:
        """These units have spoken, though nobody has asked."""
        for device in [each for each in self._resting if each.unit in units]:
            self._recover(device)

    def connected(self, has_arrived: HasArrived | None) -> None:
        """There is a port. A new connection holds nothing back."""
        self._stall = Stall(has_arrived)

    def must_renew(self, now: float) -> bool:
        """Whether the connection may hold back what was asked, so that another one is needed."""
        return self._stall.is_over(now)

    def take_underway(self, now: float) -> list[Transaction]:
        """Requests whose windows have ended, but which may only have arrived at the server since."""
        return self._stall.take_underway(now) if self._stall.is_over(now) else []

    def await_arrived(self, transaction: Transaction, expected: Expected, now: float) -> None:
        """Its limit begins only now, and its late window behind that."""
        ends_at = self._windows.end_of(transaction, now + transaction.limit)
        self._windows.open(transaction, expected, ends_at)
        self._stall.timed_out(transaction, ends_at)

    def end_rests(self) -> None:
        """The port was away: whoever failed before may be fine now."""
        for device in self._resting:
            device.breaker.record_success()
        self._resting.clear()

    def _recover(self, device: Destination) -> None:
        """The unit has spoken: its rest is over."""
        if device.breaker.failures and device.breaker.record_success():
            self._resting.discard(device)
            self._report.recovered(device)

    def _is_overdue(self, transaction: Transaction, now: float) -> bool:
        until = self._windows.forbid_until(transaction, now)
        return until is not None and until - now > WORTH_WAITING


def earliest(one: float | None, other: float | None) -> float | None:
    """The earlier of two times, of which each may be None."""
    if one is None or other is None:
        return other if one is None else one
    return min(one, other)
