"""The read of a scan that waits for idle time of a line, outside the queue: it takes no other request's place.

It is sent while nothing else waits. On a line that is never free it is sent after OTHERS other requests, but only when
all requests that waited during the scan's last read have had their turn. So no request waits for more than one read.
"""

from math import inf
from typing import Final

from gateway.errors import Unwanted
from gateway.lines.ledger import Ledger
from gateway.lines.queue import WaitingQueue
from gateway.lines.transaction import ScanTransaction

#: The number of other requests between two reads on a line that is never free.
OTHERS: Final = 16


class IdleTime:
    """Decides when the one `question` that waits here may be sent.

    Until `held_until` a late window forbids it. `others` is the number of requests sent while it waits.
    """

    def __init__(self, queue: WaitingQueue, ledger: Ledger) -> None:
        self.question: ScanTransaction | None = None
        self.held_until = 0.0
        self._queue = queue
        self._ledger = ledger
        self.others = 0
        #: The last question sent.
        self._last: ScanTransaction | None = None

    def put(self, question: ScanTransaction) -> None:
        """Keep a question until it can be sent. It replaces one that is no longer wanted."""
        before, self.question = self.question, question
        self.held_until = 0.0
        if before is not None:
            before.fail(Unwanted())

    def take(self, now: float) -> ScanTransaction | None:
        """Remove and return the question if it may be sent at `now`; None if another request may."""
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
        """Return when the question can be sent, on a line that is free at `sends_at`; None if other requests wait."""
        if self.question is None or len(self._queue):
            return None
        return max(sends_at, self.held_until)

    def clear(self) -> list[ScanTransaction]:
        """Remove and return the question, if any."""
        question, self.question = self.question, None
        return [] if question is None else [question]

    def _has_its_turn(self) -> bool:
        ended_at = -inf if self._last is None else self._last.fails_at
        return self.others >= OTHERS and self._queue.waits_since() >= ended_at
