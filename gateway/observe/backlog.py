"""The queue of log entries: bounded, so that a log that is not read costs only its own lines."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from threading import Condition
from typing import Final

from gateway.events import Level

#: The most waiting entries. Entries that clients cannot cause at will may exceed it, so that a flood of others cannot
#: displace the audit of a write.
MOST_WAITING: Final = 1000
MOST_WITH_RESERVE: Final = 2 * MOST_WAITING
#: Once entries are dropped, this many must be written before new ones are accepted.
_TAKES_AGAIN: Final = MOST_WAITING // 2


@dataclass(frozen=True, slots=True)
class Entry:
    """An entry of the log. `at` is monotonic, `clock` is the time of day (POSIX); both in seconds.

    It stands for this many `events`, `write_audits` among them.
    """

    at: float
    clock: float
    level: int
    name: str
    fields: Mapping[str, object]
    #: Whether such lines are rate limited. Only other entries may exceed MOST_WAITING.
    is_limited: bool = True
    events: int = 1
    write_audits: int = 0


@dataclass(slots=True)
class Missing:
    """The number of dropped events, and of `write_audits` among them."""

    events: int = 0
    write_audits: int = 0

    def add(self, entry: Entry) -> None:
        """Count the events of an entry that is not written."""
        self.events += entry.events
        self.write_audits += entry.write_audits

    def note(self, at: float, clock: float) -> Entry:
        """The entry that reports them: `events_dropped`."""
        fields = {"dropped": self.events, "write_audits": self.write_audits}
        return Entry(at, clock, Level.WARNING, "events_dropped", fields, False, self.events, self.write_audits)


class Backlog:
    """Entries in order. Any thread may put, one thread takes.

    When it is full, entries are dropped and counted until half of it has been taken. Then the count is added where the
    entries are missing.
    """

    def __init__(self) -> None:
        self._waiting: deque[Entry] = deque()
        self._missing = Missing()
        self._closed = False
        # Reentrant: during `put`, the garbage collector may cause asyncio to log something.
        self._changed = Condition()

    def put(self, entry: Entry) -> None:
        """Add an entry, or count it as dropped. Never waits for the writer."""
        with self._changed:
            if self._has_room(entry):
                self._waiting.append(entry)
                self._changed.notify()
            else:
                self._missing.add(entry)

    def take(self, patience: float | None = None) -> Entry | None:
        """The next entry; None if there was none for `patience` seconds (None: no limit), or it is closed and empty."""
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
        """Accept no more entries."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def is_empty(self) -> bool:
        """Whether everything has been taken that was put so far."""
        return not self._waiting

    @property
    def is_done(self) -> bool:
        """Whether it is closed and everything has been taken."""
        return self._closed and not self._waiting
