"""The question of a scan that waits for a line's idle time, outside of the queue: it takes nobody's place there.

It is sent while nobody else waits. On a line that is never free it is sent after OTHERS others, but only once all who
waited for the last question of the scan have had their turn. So no request waits for more than one of them.
"""

from math import inf
from typing import Final

from gateway.errors import Unwanted
from gateway.lines.ledger import Ledger
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import ScanTransaction

#: How many others are sent between two questions on a line that is never free.
OTHERS: Final = 16


class IdleTime:
    """When the one `question` that waits here may be sent.

    `held_until` is when no late window forbids it any more, `others` how many were sent while it waits.
    """

    def __init__(self, queue: WaitingQueue, ledger: Ledger) -> None:
        self.question: ScanTransaction | None = None
        self.held_until = 0.0
        self._queue = queue
        self._ledger = ledger
        self.others = 0
        #: The question that was sent last.
        self._last: ScanTransaction | None = None

    def put(self, question: ScanTransaction) -> None:
        """Let a question wait here, in place of one that is no longer wanted."""
        before, self.question = self.question, question
        self.held_until = 0.0
        if before is not None:
            before.fail(Unwanted())

    def take(self, now: float) -> ScanTransaction | None:
        """Take out the question if it may be sent at `now`; None if another request may."""
        question = self.question
        if question is None:
            return None
        if len(self._queue) and not self._has_its_turn():
            return None
        until = self._ledger.forbid_until(question, now) if self._ledger.late else None
        if until is not None:
            self.held_until = until
            return None
        self.question, self._last, self.others = None, question, 0
        return question

    def deadline(self, sends_at: float) -> float | None:
        """Return when it can be sent, on a line that is free at `sends_at` and for which nothing else waits."""
        if self.question is None or len(self._queue):
            return None
        return max(sends_at, self.held_until)

    def clear(self) -> list[ScanTransaction]:
        """Remove the question."""
        question, self.question = self.question, None
        return [] if question is None else [question]

    def _has_its_turn(self) -> bool:
        ended_at = -inf if self._last is None else self._last.fails_at
        return self.others >= OTHERS and self._queue.waits_since() >= ended_at
