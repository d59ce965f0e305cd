"""What is to be logged and not yet written: bounded, so that a log that nobody reads costs nothing but its lines."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from threading import Condition
from typing import Final

from gateway.events import Level, WriteAudit

#: Entries that may wait. Those that no limit applies to may go on from there, so that whoever causes many others cannot
#: make a write go untold.
MOST_WAITING: Final = 1000
MOST_UNLIMITED: Final = 2 * MOST_WAITING
#: While entries are dropped, so many must have been written before others are taken.
_TAKES_AGAIN: Final = MOST_WAITING // 2


@dataclass(frozen=True, slots=True)
class Entry:
    """Something to be logged. `at` is for comparing times, `clock` is the time of day (POSIX); both in seconds."""

    at: float
    clock: float
    level: int
    name: str
    fields: Mapping[str, object]
    #: Whether few such lines a second will do.
    is_limited: bool = True


class Backlog:
    """Entries in the order in which they came. Any thread may put, one thread takes.

    When it is full, entries are dropped and counted until half of it has been taken. Then the count follows, in the
    place of those that are missing, as the entry `events_dropped`; `write_audits` of them were accounts of writes.
    """

    def __init__(self) -> None:
        self._waiting: deque[Entry] = deque()
        self._dropped = 0
        self._dropped_audits = 0
        self._closed = False
        # Reentrant: the garbage collector may let asyncio complain in the middle of `put`.
        self._changed = Condition()

    def put(self, entry: Entry) -> None:
        """Add an entry, or count it as dropped. Never waits for the one who takes."""
        with self._changed:
            if self._has_room(entry):
                self._waiting.append(entry)
                self._changed.notify()
            else:
                self._dropped += 1
                self._dropped_audits += entry.name == WriteAudit.name

    def take(self, patience: float | None = None) -> Entry | None:
        """The next entry; None when there was none for so many seconds (None: for ever), or no other will come."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, patience)
            if not self._waiting:
                return None
            entry = self._waiting.popleft()
            if self._dropped and len(self._waiting) <= _TAKES_AGAIN:
                dropped = {"dropped": self._dropped, "write_audits": self._dropped_audits}
                note = Entry(entry.at, entry.clock, Level.WARNING, "events_dropped", dropped, is_limited=False)
                self._waiting.append(note)
                self._dropped = self._dropped_audits = 0
            return entry

    def _has_room(self, entry: Entry) -> bool:
        if entry.is_limited:
            return not self._dropped and len(self._waiting) < MOST_WAITING
        return len(self._waiting) < MOST_UNLIMITED

    def close(self) -> None:
        """No other entry will come."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def is_done(self) -> bool:
        """Whether it is closed and everything has been taken."""
        return self._closed and not self._waiting
