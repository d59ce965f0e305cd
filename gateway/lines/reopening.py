"""A connection that was closed while it was not needed: the next request has it opened again, and waits for it."""

from collections.abc import Callable

from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import Transaction
from gateway.ports.port import OpenAgain


class Reopening:
    """Has a closed connection opened for the requests in `queue`. `is_on` while it is closed.

    Each request waits for `max_wait` or its limit, from `limit_of`, whichever is shorter, and for the silence
    `after_connect`. `until` is the first end of these.
    """

    __slots__ = ("_after_connect", "_limit_of", "_max_wait", "_open_again", "_queue", "_since", "is_on", "until")

    def __init__(
        self,
        queue: WaitingQueue,
        max_wait: float,
        limit_of: Callable[[Transaction], float],
        after_connect: float = 0.0,
    ) -> None:
        self.is_on = False
        self.until: float | None = None
        self._queue = queue
        self._max_wait = max_wait
        self._limit_of = limit_of
        self._after_connect = after_connect
        self._since = 0.0
        self._open_again: OpenAgain | None = None

    def begin(self, now: float) -> None:
        """Start: the connection is closed, or about to be."""
        self.is_on = True
        self.until = None
        self._since = now
        self._queue.wait_longer(self._after_connect)

    def ended(self, open_again: OpenAgain, *, is_needed: bool) -> None:
        """Keep `open_again`, and call it at once if the connection `is_needed`."""
        self._open_again = open_again
        if is_needed:
            self._plan()
            self._open()

    def need(self, transaction: Transaction) -> None:
        """Have the connection opened for this request."""
        until = self._until(transaction)
        self.until = until if self.until is None else min(self.until, until)
        self._open()

    def end(self, now: float) -> None:
        """Stop: the connection is open, or cannot be opened."""
        self.is_on = False
        self.until = None
        self._open_again = None
        self._queue.wait_as_ever(now)

    def given_up(self, now: float) -> list[Transaction]:
        """Remove and return the requests that have waited too long for the connection."""
        if self.until is None or now < self.until:
            return []
        late = self._queue.drop(lambda waiting: self._until(waiting) <= now)
        self._plan()
        return late

    def _open(self) -> None:
        open_again, self._open_again = self._open_again, None
        if open_again is not None:
            open_again()

    def _plan(self) -> None:
        self.until = min(map(self._until, self._queue), default=None)

    def _until(self, transaction: Transaction) -> float:
        since = max(self._since, transaction.requests[0].received_at)
        return since + min(self._limit_of(transaction), self._max_wait) + self._after_connect
