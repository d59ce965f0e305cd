"""The thread that writes the log, so that the gateway never waits for its reader."""

import os
import sys
import time
from collections.abc import Callable
from math import inf
from queue import Empty
from threading import Thread
from typing import Final, Protocol

from gateway.observe.backlog import MOST_WITH_RESERVE, Backlog, Entry, Missing
from gateway.observe.limits import Limits

#: How long stopping waits for the log to be written, in seconds.
CLOSING_PATIENCE: Final = 0.5
#: While clients cause more events than are written, the thread looks at them once in this many seconds. Waking it for
#: each of them would take more of the event loop's time than the event itself.
PAUSE: Final = 0.02


class Stream(Protocol):
    """Where the log goes."""

    def write(self, text: str, /) -> object:
        """Write the text; may block."""

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""


class StandardError:
    """Standard error without Python's buffer: its lock, held by a blocked thread, would abort the process at exit."""

    def write(self, text: str) -> None:
        """Write the whole text.

        Raises:
            OSError: it cannot be written.
        """
        if sys.stderr is None:  # closed by the parent process: descriptor 2 may be anything now
            return
        rest = text.encode("utf-8", "backslashreplace")
        while rest:
            rest = rest[os.write(2, rest) :]

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""
        return sys.stderr is not None and sys.stderr.isatty()


class Writer:
    """Writes the entries of `backlog` with `write`, as often as `Limits` allow. `write` may block.

    Entries that it cannot write (OSError, ValueError) are dropped and counted; the count is written as soon as
    possible, before the next entry.
    """

    def __init__(self, backlog: Backlog, write: Callable[[Entry], object]) -> None:
        self._backlog = backlog
        self._write_one = write
        self._limits = Limits()
        self._missing = Missing()
        # A daemon thread: a blocked write must not keep the process from exiting.
        self._thread = Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write waiting entries for up to CLOSING_PATIENCE. The last call."""
        self._backlog.add_note(MOST_WITH_RESERVE)
        self._backlog.put(None)
        self._thread.join(CLOSING_PATIENCE)

    def _run(self) -> None:
        for entry in iter(self._take, None):
            self._backlog.add_note()
            self._write_counts(entry.at)
            if self._limits.admit(entry):
                self._write(entry)
            elif self._backlog.empty():
                time.sleep(PAUSE)
        self._write_counts(inf)

    def _take(self) -> Entry | None:
        """Take the next entry, None at the end; write counts that are due meanwhile."""
        while True:
            try:
                return self._backlog.get(timeout=self._until_next_count())
            except Empty:
                self._write_counts(time.monotonic())

    def _until_next_count(self) -> float | None:
        due = self._limits.next_due
        return None if due is None else max(0.0, due - time.monotonic())

    def _write_counts(self, now: float) -> None:
        for count in self._limits.counts(now):
            self._write(count)

    def _write(self, entry: Entry) -> None:
        try:
            if self._missing.events:
                self._write_one(self._missing.note())
                self._missing = Missing()
            self._write_one(entry)
        except (OSError, ValueError):
            self._missing.add(entry)
