"""What a line and an upstream decide alike: which requests have no place, why others are not sent, which units rest.

Turns and equal reads are up to `queue`, a connection that is closed while nobody needs it to `reopening`. What differs:

|                     | a line (`line`, `scheduler`)              | an upstream (`upstreams/upstream`)            |
|---------------------|-------------------------------------------|-----------------------------------------------|
| under way           | one request                               | `in_flight`, of one client to one unit one    |
| whose a response is | `attribution` finds out                   | its identifier says                           |
| late responses      | forbid requests for a while (`ledger`)    | keep their identifiers taken (`in_flight`)    |
| a write to bits     | its write is next after its read          | and nothing else to the unit meanwhile        |
| a read is repeated  | at once after damage; after silence when  | at once, before all that waits                |
|                     | its late window has ended                 |                                               |
"""

from gateway import errors
from gateway.errors import RequestError
from gateway.lines.queue import WaitingQueue
from gateway.lines.refusals import Refusals
from gateway.lines.reopening import Reopening
from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction
from gateway.request import Request


class Waiting:
    """The waiting requests of a line or an upstream, and the units that rest, each for `longest_rest` at most."""

    def __init__(self, queue: WaitingQueue, reopening: Reopening, telling: Telling, longest_rest: float | None) -> None:
        self.queue = queue
        self.reopening = reopening
        self.refusals = Refusals(telling)
        self._telling = telling
        self._longest_rest = longest_rest
        self._resting: set[Destination] = set()

    def keep(self, transaction: Transaction, now: float) -> RequestError | None:
        """Keep a transaction until its turn. Another one may lose its place. Return the error if this one has none."""
        lost = self.queue.put(transaction, now)
        if lost is None:
            return None
        self.refusals.add(lost, now)
        if lost is transaction:
            return errors.QueueFull()
        self._telling.record_refused(lost, errors.QueueFull(), now, waiting=len(self.queue))
        lost.fail(errors.QueueFull())
        return None

    def refuse(self, transaction: Transaction, error: RequestError, now: float) -> None:
        """Fail a request that was not sent, and record why."""
        self._telling.record_refused(transaction, error, now, waiting=len(self.queue))
        transaction.fail(error)

    def fail_unsent(self, transactions: list[Transaction], now: float) -> None:
        """Fail these transactions because the port was lost: repeats as sent before, others as not sent."""
        for transaction in transactions:
            self.refuse(transaction, errors.LineLost() if transaction.is_repeat else errors.LineDown(), now)

    def fail_expired(self, late: tuple[tuple[Request, str], ...], now: float) -> None:
        """Fail these requests, each with the name of its device: they have waited too long, and were not sent."""
        for request, name in late:
            self._telling.record_expired(request, name, errors.WaitedTooLong(), now)
            request.fail(errors.WaitedTooLong())

    def count_failure(self, transaction: Transaction, window_end: float, now: float) -> None:
        """Count a failure of the unit that has not responded; it may have to rest, from `window_end` on."""
        device, failed_before = transaction.device, transaction.failures
        transaction.failures += 1
        if device.breaker.record_failure(
            transaction.limit, window_end, self._longest_rest, failed_before=failed_before
        ):
            self._resting.add(device)
            self._telling.resting(device, now)

    def recover(self, device: Destination) -> None:
        """End the rest of a unit that has responded."""
        if device.breaker.failures and device.breaker.record_success():
            self._resting.discard(device)
            self._telling.recovered(device)

    def end_rests(self) -> None:
        """End all rests: the port was lost, so units that failed before may respond now."""
        for device in self._resting:
            device.breaker.record_success()
        self._resting.clear()
