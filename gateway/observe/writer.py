"""A thread that writes the log: whoever has something to tell never waits for whoever reads it."""

import os
import sys
import time
from collections.abc import Callable
from math import inf
from threading import Thread
from typing import Final, Protocol

from gateway.events import AccessDenied, ClientRejected, QueueFull, RequestRefused, WriteAudit
from gateway.observe.backlog import Backlog, Entry, Missing
from gateway.observe.limiter import Limiter, Subject, subject_of

#: How long a gateway that ends waits for its log to be read, in seconds.
CLOSING_PATIENCE: Final = 0.5
#: What clients cause as often as they like, from as many addresses as they like: datagrams can be forged. Not refused
#: writes: none of a client goes untold because of others.
CAUSED_BY_CLIENTS: Final = frozenset({AccessDenied.name, ClientRejected.name, QueueFull.name, RequestRefused.name})
MOST_CAUSED: Final = 50


class Stream(Protocol):
    """Where the log goes."""

    def write(self, text: str, /) -> object:
        """Write the text; may take as long as it likes."""

    def isatty(self) -> bool:
        """Whether it is a terminal."""


class StandardError:
    """Standard error past Python's buffer: the lock of that, in a thread that hangs, would abort the process's end."""

    def write(self, text: str) -> None:
        """Write the text to its end.

        Raises:
            OSError: it cannot be written.
        """
        if sys.stderr is None:  # closed by whoever started us: descriptor 2 may be anything now
            return
        rest = text.encode("utf-8", "backslashreplace")
        while rest:
            rest = rest[os.write(2, rest) :]

    def isatty(self) -> bool:
        """Whether a person may be looking."""
        return sys.stderr is not None and sys.stderr.isatty()


class Writer:
    """Has entries written by `write`, each subject as often as its limiter allows.

    With each name of CAUSED_BY_CLIENTS there are at most MOST_CAUSED lines in ten seconds, counts among them.
    `write` may take as long as it likes. What it cannot write (OSError, ValueError) is given up and counted; the count
    is written as soon as that is possible again, before what comes next.
    """

    def __init__(self, write: Callable[[Entry], object]) -> None:
        self._write_one = write
        self._usual = Limiter()
        # What others can cause as often as they like. However many are sent away, writes that are refused are told.
        self._of_refusals = {
            ClientRejected.name: Limiter(lines=1, seconds=10.0),
            WriteAudit.name: Limiter(lines=1, seconds=10.0, steady=inf),
        }
        self._in_total = Limiter(lines=MOST_CAUSED, seconds=10.0, steady=inf)
        self._limiters = (self._usual, *self._of_refusals.values(), self._in_total)
        self._backlog = Backlog()
        self._missing = Missing()
        # A daemon, because a write that hangs must not keep the process from ending.
        self._thread = Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def put(self, entry: Entry) -> None:
        """Have an entry written soon. Never waits."""
        self._backlog.put(entry)

    def close(self) -> None:
        """Write what waits, as far as the stream takes it within CLOSING_PATIENCE. The last call."""
        self._backlog.close()
        self._thread.join(CLOSING_PATIENCE)

    def _run(self) -> None:
        while not self._backlog.is_done:
            entry = self._backlog.take(self._until_next_count())
            self._write_counts(time.monotonic() if entry is None else entry.at)
            if entry is not None and self._admits(entry):
                self._write(entry)
        self._write_counts(inf)

    def _until_next_count(self) -> float | None:
        due = [each.next_due for each in self._limiters if each.next_due is not None]
        return max(0.0, min(due) - time.monotonic()) if due else None

    def _admits(self, entry: Entry) -> bool:
        if not entry.is_limited:
            return True
        limiter = self._of_refusals.get(entry.name, self._usual)
        subject = subject_of(entry.level, entry.name, entry.fields)
        return limiter.admits(subject, entry.at) and self._admits_in_total(subject, entry.at)

    def _admits_in_total(self, subject: Subject, now: float, events: int = 1) -> bool:
        if subject.name not in CAUSED_BY_CLIENTS:
            return True
        return self._in_total.admits(Subject(subject.level, subject.name), now, events)

    def _write_counts(self, now: float) -> None:
        for limiter in self._limiters:
            for subject, count in limiter.due(now):
                if limiter is self._in_total or self._admits_in_total(subject, time.monotonic(), count):
                    self._write(_count(subject, count))

    def _write(self, entry: Entry) -> None:
        try:
            if self._missing.events:
                self._write_one(self._missing.note(entry.at, entry.clock))
                self._missing = Missing()
            self._write_one(entry)
        except (OSError, ValueError):
            self._missing.add(entry)


def _count(subject: Subject, count: int) -> Entry:
    fields = {**dict(subject.key), "suppressed": count}
    audits = count if subject.name == WriteAudit.name else 0
    return Entry(time.monotonic(), time.time(), subject.level, subject.name, fields, events=count, write_audits=audits)
