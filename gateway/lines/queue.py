"""Requests that wait for their line."""

from collections import deque

from gateway.lines.transaction import Transaction


class WaitingQueue:
    """First come, first served, with a bound on how many wait and on how long each one does.

    `size` is the most that wait, `max_wait` the longest time in seconds. What nobody wants any more ends without a
    response.
    """

    def __init__(self, size: int, max_wait: float) -> None:
        self._size = size
        self._max_wait = max_wait
        self._waiting: deque[Transaction] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, transaction: Transaction, now: float) -> bool:
        """Let `transaction` wait from `now` on; False when the queue is full."""
        if len(self._waiting) >= self._size:
            self._drop_unwanted()
            if len(self._waiting) >= self._size:
                return False
        transaction.waits_until = now + self._max_wait
        self._waiting.append(transaction)
        return True

    def take(self) -> Transaction | None:
        """The next transaction that its client still wants."""
        while self._waiting:
            transaction = self._waiting.popleft()
            if transaction.is_wanted:
                return transaction
            transaction.request.end()
        return None

    def expired(self, now: float) -> list[Transaction]:
        """Remove those that have waited too long at `now`."""
        waiting, late = self._waiting, []
        while waiting and waiting[0].waits_until <= now:
            late.append(waiting.popleft())
        return late

    def next_expiry(self) -> float | None:
        """When the next one will have waited too long."""
        return self._waiting[0].waits_until if self._waiting else None

    def clear(self) -> list[Transaction]:
        """Remove all."""
        waiting = list(self._waiting)
        self._waiting.clear()
        return waiting

    def _drop_unwanted(self) -> None:
        unwanted = [waiting for waiting in self._waiting if not waiting.is_wanted]
        self._waiting = deque(waiting for waiting in self._waiting if waiting.is_wanted)
        for transaction in unwanted:
            transaction.request.end()
