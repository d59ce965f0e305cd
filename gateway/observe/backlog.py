"""The queue of log entries: bounded, so that a log that is not read costs only its own lines."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import RLock
from typing import Final

from gateway.events import Event, EventsDropped, Level, QueueFull, WriteAudit

#: The most waiting entries. Entries that clients cannot cause at will may exceed it, so that a flood of others cannot
#: displace the audit of a write.
MOST_WAITING: Final = 1000
MOST_WITH_RESERVE: Final = 2 * MOST_WAITING
#: Once entries are dropped, this many must be written before new ones are accepted.
TAKES_AGAIN: Final = MOST_WAITING // 2


@dataclass(slots=True)  # a frozen one takes three times as long to make
class Entry:
    """An entry of the log. `at` is monotonic, `clock` is the time of day (POSIX); both in seconds.

    It stands for this many `events`, `write_audits` among them.
    """

    level: int
    name: str
    fields: Mapping[str, object]
    #: Whether such lines are rate limited. Only other entries may exceed MOST_WAITING.
    is_limited: bool = True
    events: int = 1
    write_audits: int = 0
    at: float = field(default_factory=time.monotonic)
    clock: float = field(default_factory=time.time)


def entry_of(event: Event) -> Entry:
    """Make the entry of an event."""
    audits = int(isinstance(event, WriteAudit))
    # Errors are rare, and each write must be audited; but any client can cause refused writes.
    limited = not event.was_sent if isinstance(event, WriteAudit) else event.level < Level.ERROR
    return Entry(event.level, event.name, event.fields(), limited, number_of(event), audits)


def number_of(event: Event) -> int:
    """Return how often it has happened: once, unless it was counted."""
    return event.times or 1 if isinstance(event, QueueFull) else 1


@dataclass(slots=True)
class Missing:
    """The number of dropped events, and of `write_audits` among them."""

    events: int = 0
    write_audits: int = 0

    def add(self, entry: Entry) -> None:
        """Count the events of an entry that is not written."""
        self.events += entry.events
        self.write_audits += entry.write_audits

    def note(self) -> Entry:
        """Make the entry that reports them: `events_dropped`."""
        told = EventsDropped(self.events, self.write_audits)
        return Entry(told.level, told.name, told.fields(), False, self.events, self.write_audits)


class Backlog(SimpleQueue[Entry | None]):
    """Entries in order, None at the end. Any thread may `add`, one thread gets.

    When it is full, entries are dropped and counted until half of it has been taken. Then `add_note` adds the count
    where the entries are missing.
    """

    def __init__(self) -> None:
        self._missing = Missing()
        # Reentrant, as the queue is: during `add`, the garbage collector may cause asyncio to log something.
        self._lock = RLock()

    def add(self, entry: Entry) -> None:
        """Add an entry, or count it as dropped. Never waits for the writer."""
        with self._lock:
            if self._has_room(entry):
                self.put(entry)
            else:
                self._missing.add(entry)

    def add_note(self, most_waiting: int = TAKES_AGAIN) -> None:
        """Add the count of dropped entries, if any were dropped and at most `most_waiting` entries wait."""
        with self._lock:
            if self._missing.events and self.qsize() <= most_waiting:
                self.put(self._missing.note())
                self._missing = Missing()

    def _has_room(self, entry: Entry) -> bool:
        if entry.is_limited:
            return not self._missing.events and self.qsize() < MOST_WAITING
        return self.qsize() < MOST_WITH_RESERVE
