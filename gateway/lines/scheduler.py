"""Chooses the waiting request that is sent next on a line, and refuses those that must not be sent.

A request is not sent while its unit rests (`breaker`), while a late response could be taken for its own or its
connection may hold back earlier requests (`ledger`), or if its response would equal it on a line that echoes (`echo`).
The scheduler sees no bytes.
"""

from collections.abc import Callable
from typing import Final

from gateway import errors
from gateway.errors import RequestError
from gateway.lines.echo import EchoDetector
from gateway.lines.exchange import Exchange
from gateway.lines.idle import IdleTime
from gateway.lines.ledger import WORTH_WAITING, Ledger
from gateway.lines.queue import WaitingQueue
from gateway.lines.reopening import Reopening
from gateway.lines.settings import LineSettings
from gateway.lines.telling import Telling
from gateway.lines.transaction import ScanTransaction, Transaction
from gateway.lines.waiting import Waiting

_SHARED: Final = (
    "another client writes on this line too, and would be overwritten; if the device has function 22, "
    "name it in the `functions` of its profile"
)

#: Tells whether a request may be written now.
MaySend = Callable[[], bool]


class Scheduler(Waiting):
    """The waiting requests of one line, and the units that rest.

    `limit_of` returns the time limit of a transaction. `may_send` is set on a line that several gateways use.
    """

    def __init__(
        self,
        settings: LineSettings,
        ledger: Ledger,
        echo: EchoDetector,
        telling: Telling,
        limit_of: Callable[[Transaction], float],
    ) -> None:
        queue = WaitingQueue(settings.queue, settings.max_wait, coalesce=settings.coalesce)
        reopening = Reopening(queue, settings.max_wait, limit_of, settings.after_connect)
        super().__init__(queue, reopening, telling, settings.rest)
        self._ledger = ledger
        self._echo = echo
        self.may_send: MaySend | None = None
        self._idle = IdleTime(queue, ledger)
        self._max_wait = settings.max_wait
        self._held_until = 0.0

    def put(self, transaction: Transaction, now: float) -> RequestError | None:
        """Keep a transaction until its turn. Return the reason if it cannot be sent, else None."""
        if isinstance(transaction, ScanTransaction):
            self._idle.put(transaction)
            return None
        rejection = self.rejection(transaction, now)
        if rejection is not None:
            return rejection
        if self._ledger.late and self._is_forbidden(transaction, now):
            return errors.AnswerOverdue()
        self._held_until = 0.0
        return self.keep(transaction, now)

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits, not even a read of a scan."""
        return not len(self.queue) and self._idle.question is None

    def sent(self) -> None:
        """Note that a request is sent, for the first time or again."""
        if self._idle.question is not None:
            self._idle.others += 1

    def next(self, now: float) -> Transaction | None:
        """Remove and return the next transaction; None if none may be sent now."""
        if self._ledger.late and self._ledger.must_renew(now):
            return None
        following = self.queue.take_following()
        if following is not None:
            return following
        question = self._idle.take(now)
        if question is not None:
            return question
        return self._next_allowed(now) if self._ledger.late else self.queue.take()

    def _next_allowed(self, now: float) -> Transaction | None:
        """Do the part of `next` that needs a lambda: in `next` itself, each call would create its object."""
        transaction = self.queue.take(lambda waiting: self._ledger.forbid_until(waiting, now) is not None)
        if transaction is None and len(self.queue):
            self._held_until = self._ledger.next_end() or 0.0
        return transaction

    def rejection(self, transaction: Transaction, now: float) -> RequestError | None:
        """Return why a transaction must not be sent; None if it may."""
        if self._resting and not transaction.retries and transaction.device.breaker.is_resting(now):
            return errors.UnitResting()
        if self._echo.is_suspected and transaction.expects_answer and transaction.asked.accepts(transaction.asked.data):
            return errors.EchoSuspected()
        other_client = self._ledger.other_client
        if other_client is not None and transaction.is_of_bits and now < other_client.ends_at:
            return errors.LineShared(_SHARED)
        return None

    def deadline(self, sends_at: float) -> float | None:
        """Return when the next request can be sent, on a line that is free at `sends_at`, or has waited too long."""
        deadline = self.queue.next_expiry()
        if self._ledger.late:
            deadline = earliest(deadline, self._ledger.renews_at())
        deadline = earliest(self._idle.deadline(sends_at), deadline)
        return earliest(max(sends_at, self._held_until), deadline) if len(self.queue) else deadline

    def clear(self) -> list[Transaction]:
        """Remove and return everything that waits."""
        return [*self.queue.clear(), *self._idle.clear()]

    def end(self, now: float) -> tuple[Transaction, ...]:
        """End the request on the line. If responses are owed, its late window opens.

        Return the waiting transactions that the window forbids for too long, which are removed. Repeats stay: they wait
        for it anyway.
        """
        if not self._ledger.end(now):
            return ()
        return tuple(self.queue.drop(lambda waiting: not waiting.retries and self._is_forbidden(waiting, now)))

    def refuse(self, transaction: Transaction, error: RequestError, now: float) -> None:
        """Fail a request that was not sent, and record why."""
        until = self._ledger.forbid_until(transaction, now) if self._ledger.late else None
        self._telling.record_refused(transaction, error, now, waiting=len(self.queue), late_until=until or 0.0)
        transaction.fail(error)

    def fail_forbidden(self, transactions: tuple[Transaction, ...], now: float) -> None:
        """Fail these transactions: a late response could be taken for theirs."""
        for transaction in transactions:
            self.refuse(transaction, errors.AnswerOverdue(), now)

    def record_failure(self, transaction: Transaction, now: float) -> None:
        """Count a failure of the unit that has not responded; it may have to rest when its late window has ended."""
        self.count_failure(transaction, self._ledger.end_of(transaction, now), now)

    def record_response(self, exchange: Exchange) -> None:
        """Note a valid response to `exchange`, in time or late."""
        self._held_until = self._idle.held_until = 0.0
        self._ledger.release(exchange)
        self.recover(exchange.sender.device)

    @property
    def resting(self) -> set[int]:
        """The addresses of the units that rest."""
        return {device.unit for device in self._resting}

    def record_frames(self, units: set[int]) -> None:
        """Note that valid frames came from these units without a request."""
        for device in [each for each in self._resting if each.unit in units]:
            self.recover(device)

    def _is_forbidden(self, transaction: Transaction, now: float) -> bool:
        """Tell whether a late window forbids it for too long.

        A device that sleeps and has answered leaves one open each time it was woken, so its requests wait for that.
        """
        until, device = self._ledger.forbid_until(transaction, now), transaction.device
        worth_waiting = self._max_wait if device.sleep.wake and not device.breaker.failures else WORTH_WAITING
        return until is not None and until - now > worth_waiting


def earliest(one: float | None, other: float | None) -> float | None:
    """Return the earlier of two times, each of which may be None."""
    if one is None or other is None:
        return other if one is None else one
    return min(one, other)
