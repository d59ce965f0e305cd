"""Who has most requests waiting: found without a search, however many wait."""

from collections.abc import Iterable
from heapq import heapify, heappop, heappush, heapreplace
from itertools import count

from gateway.lines.turns import Row


class Crowd:
    """Rows, those in which most requests wait first; of equals, those whose address has most.

    It is made when somebody is refused, and used until `most` entries are in it. Until then a row that grows is entered
    again. What shrinks is not: an entry that says too much is corrected when it comes up.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._entries: list[tuple[int, int, int, Row]] = []
        self._numbers = count()

    def grown(self, row: Row) -> None:
        """One more request waits in a row."""
        if len(self._entries) >= self._most:
            self._entries.clear()
        if self._entries:
            heappush(self._entries, self._entry(row))

    def greediest(self, rows: Iterable[Row]) -> Row | None:
        """The row that loses a request, of all `rows`. Repeats are not lost: 06 means that nothing was sent."""
        entries = self._entries
        if not entries:
            entries.extend(map(self._entry, rows))
            heapify(entries)
        while entries:
            row = entries[0][-1]
            if not row.waiting or row.places[-1].transaction.retries:
                heappop(entries)
            elif entries[0][:2] != self._entry(row)[:2]:
                heapreplace(entries, self._entry(row))
            else:
                return row
        return None

    def _entry(self, row: Row) -> tuple[int, int, int, Row]:
        return -row.waiting, -row.address.waiting, next(self._numbers), row
