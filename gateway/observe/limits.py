"""How often the log tells what: the limits of all events together."""

import time
from collections.abc import Iterator
from math import inf
from typing import Final

from gateway.events import AccessDenied, ClientRejected, QueueFull, RequestRefused, WriteAudit
from gateway.observe.backlog import Entry
from gateway.observe.limiter import Limiter, Subject, subject_of

#: Events that clients can cause in any number from any number of addresses, because datagrams can be forged. Without
#: refused writes: those of one client must not be hidden by others.
CAUSED_BY_CLIENTS: Final = frozenset({AccessDenied.name, ClientRejected.name, QueueFull.name, RequestRefused.name})
MOST_CAUSED: Final = 50


class Limits:
    """Admits the entries about each subject as often as its limiter allows, and counts the others.

    Each event in CAUSED_BY_CLIENTS has at most MOST_CAUSED lines in ten seconds, counts included.
    """

    def __init__(self) -> None:
        self._usual = Limiter()
        # Limits for events that clients can cause at will. Refused writes are logged however many clients are rejected.
        self._of_refusals = {
            ClientRejected.name: Limiter(lines=1, seconds=10.0),
            WriteAudit.name: Limiter(lines=1, seconds=10.0, steady=inf),
        }
        self._in_total = Limiter(lines=MOST_CAUSED, seconds=10.0, steady=inf)
        self._limiters = (self._usual, *self._of_refusals.values(), self._in_total)

    @property
    def next_due(self) -> float | None:
        """The time at which the next count is due, if there is one."""
        return min((each.next_due for each in self._limiters if each.next_due is not None), default=None)

    def admit(self, entry: Entry) -> bool:
        """Tell whether an entry may be written; if not, count it."""
        if not entry.is_limited:
            return True
        limiter = self._of_refusals.get(entry.name, self._usual)
        subject = subject_of(entry.level, entry.name, entry.fields)
        admits, at, events = limiter.admits, entry.at, entry.events
        return admits(subject, at, events) and self._admit_in_total(subject, at, events)

    def counts(self, now: float) -> Iterator[Entry]:
        """Yield the counts that are due, each to be written as one line about its subject."""
        for limiter in self._limiters:
            for subject, count in limiter.due(now):
                if limiter is self._in_total or self._admit_in_total(subject, time.monotonic(), count):
                    yield _count(subject, count)

    def _admit_in_total(self, subject: Subject, now: float, events: int = 1) -> bool:
        if subject.name not in CAUSED_BY_CLIENTS:
            return True
        return self._in_total.admits(Subject(subject.level, subject.name), now, events)


def _count(subject: Subject, count: int) -> Entry:
    fields = {**dict(subject.key), "suppressed": count}
    audits = count if subject.name == WriteAudit.name else 0
    return Entry(subject.level, subject.name, fields, events=count, write_audits=audits)
