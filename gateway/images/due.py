"""When the ranges of a device are polled next."""

from collections import deque
from heapq import heapify, heappop, heappush
from itertools import count
from typing import Final

from gateway.images.polled_range import PolledRange

#: So many entries may be there before those that do not count any more are looked for.
_FEW: Final = 64

#: A time, a number that no other has, and a range that is due then if that is its `due_at`.
_Entry = tuple[float, int, PolledRange]


class Due:
    """Ranges by the times at which they are due. All of them become due at the cost of one."""

    def __init__(self) -> None:
        self._entries: list[_Entry] = []
        #: Those from before each of these times: all of them are due since then.
        self._since: deque[tuple[float, list[_Entry]]] = deque()
        self._number = count()
        self._most = _FEW

    def __len__(self) -> int:
        """Count the entries, with those that do not count any more."""
        return len(self._entries) + sum(len(entries) for _, entries in self._since)

    def plan(self, polled: PolledRange, at: float) -> None:
        """Set when a range is due; one whose poll is in progress is so again when that is over."""
        polled.due_at = at
        if polled.is_asked or polled.is_over:
            return
        heappush(self._entries, (at, next(self._number), polled))
        if len(self._entries) > self._most:
            self._entries = list({entry[2]: entry for entry in self._entries if entry[2].is_due_at(entry[0])}.values())
            heapify(self._entries)
            self._most = 2 * len(self._entries) + _FEW

    def all_due(self, now: float) -> None:
        """Let all ranges be due now that would be later, but for those with halves."""
        if self._entries:
            self._since.append((now, self._entries))
            self._entries = []

    def deadline(self) -> float | None:
        """Return when something is due, or earlier; None if there is nothing."""
        while self._entries and not self._entries[0][2].is_due_at(self._entries[0][0]):
            heappop(self._entries)
        if self._since:
            return self._since[0][0]
        return self._entries[0][0] if self._entries else None

    def take(self, now: float) -> tuple[float, PolledRange] | None:
        """Take a range that is due, and since when it is. None if none is, or an entry that does not count any more."""
        if self._entries and self._entries[0][0] <= now:
            at, _, polled = heappop(self._entries)
            return (at, polled) if polled.is_due_at(at) else None
        if not self._since:
            return None
        since, entries = self._since[0]
        at, _, polled = heappop(entries)
        if not entries:
            self._since.popleft()
        if not polled.is_due_at(at):
            return None
        if polled.halves and at > now:
            self.plan(polled, at)
            return None
        return min(at, since), polled
