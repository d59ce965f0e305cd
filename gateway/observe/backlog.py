"""What is to be logged and not yet written: bounded, so that a log that nobody reads costs nothing but its lines."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from threading import Condition
from typing import Final

from gateway.events import Level

#: Entries that may wait. Those that nobody can cause at will may go on from there, so that whoever causes many others
#: cannot make a write go untold.
MOST_WAITING: Final = 1000
MOST_WITH_RESERVE: Final = 2 * MOST_WAITING
#: While entries are dropped, so many must have been written before others are taken.
_TAKES_AGAIN: Final = MOST_WAITING // 2


@dataclass(frozen=True, slots=True)
class Entry:
    """Something to be logged. `at` is for comparing times, `clock` is the time of day (POSIX); both in seconds.

    It tells of so many `events`, of which so many are `write_audits`.
    """

    at: float
    clock: float
    level: int
    name: str
    fields: Mapping[str, object]
    #: Whether few such lines a second will do. It leaves the last places to others then.
    is_limited: bool = True
    events: int = 1
    write_audits: int = 0


@dataclass(slots=True)
class Missing:
    """Events that the log lacks; so many of them were `write_audits`."""

    events: int = 0
    write_audits: int = 0

    def add(self, entry: Entry) -> None:
        """Count those of an entry that will not be written."""
        self.events += entry.events
        self.write_audits += entry.write_audits

    def note(self, at: float, clock: float) -> Entry:
        """The entry that tells of them: `events_dropped`."""
        fields = {"dropped": self.events, "write_audits": self.write_audits}
        return Entry(at, clock, Level.WARNING, "events_dropped", fields, False, self.events, self.write_audits)


class Backlog:
    """Entries in the order in which they came. Any thread may put, one thread takes.

    When it is full, entries are dropped and counted until half of it has been taken. Then the count follows, in the
    place of those that are missing.
    """

    def __init__(self) -> None:
        self._waiting: deque[Entry] = deque()
        self._missing = Missing()
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
                self._missing.add(entry)

    def take(self, patience: float | None = None) -> Entry | None:
        """The next entry; None when there was none for so many seconds (None: for ever), or no other will come."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, patience)
            if not self._waiting:
                return None
            entry = self._waiting.popleft()
            if self._missing.events and len(self._waiting) <= _TAKES_AGAIN:
                self._waiting.append(self._missing.note(entry.at, entry.clock))
                self._missing = Missing()
            return entry

    def _has_room(self, entry: Entry) -> bool:
        if entry.is_limited:
            return not self._missing.events and len(self._waiting) < MOST_WAITING
        return len(self._waiting) < MOST_WITH_RESERVE

    def close(self) -> None:
        """No other entry will come."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def is_done(self) -> bool:
        """Whether it is closed and everything has been taken."""
        return self._closed and not self._waiting
