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
#: After what it has written the thread looks for more once in this many seconds. Waking it for each entry would take
#: more of the event loop's time than the event itself.
PAUSE: Final = 0.02
#: So many lines are written together at most.
MOST_TOGETHER: Final = 64


class Stream(Protocol):
    """Where the log goes."""

    def write(self, text: str, /) -> object:
        """Write the text, now or at the next `flush`; may block."""

    def flush(self) -> None:
        """Write what is not written yet; may block."""

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""


class StandardError:
    """Standard error without Python's buffer: its lock, held by a blocked thread, would abort the process at exit."""

    def __init__(self) -> None:
        self._texts: list[str] = []

    def write(self, text: str) -> None:
        """Keep the text for `flush`."""
        self._texts.append(text)

    def flush(self) -> None:
        """Write the whole of all texts.

        Raises:
            OSError: some of it cannot be written.
        """
        rest = "".join(self._texts).encode("utf-8", "backslashreplace")
        self._texts.clear()
        if sys.stderr is None:  # closed by the parent process: descriptor 2 may be anything now
            return
        while rest:
            rest = rest[os.write(2, rest) :]

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""
        return sys.stderr is not None and sys.stderr.isatty()


class Writer:
    """Writes the entries of `backlog` with `write` and `flush`, as often as `Limits` allow. These may block.

    An entry is written at once; those that come within PAUSE after it are written together. Entries that it cannot
    write (OSError, ValueError) are dropped and counted; the count is written as soon as possible, before the next one.
    """

    def __init__(self, backlog: Backlog, write: Callable[[Entry], object], flush: Callable[[], object]) -> None:
        self._backlog = backlog
        self._write_one = write
        self._flush_all = flush
        self._not_flushed: list[Entry] = []
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
            if self._backlog.empty():
                self._flush()
                time.sleep(PAUSE)
        self._write_counts(inf)
        self._flush()

    def _take(self) -> Entry | None:
        """Take the next entry, None at the end; write counts that are due meanwhile."""
        while True:
            try:
                return self._backlog.get(timeout=self._until_next_count())
            except Empty:
                self._write_counts(time.monotonic())
                self._flush()

    def _until_next_count(self) -> float | None:
        due = self._limits.next_due
        return None if due is None else max(0.0, due - time.monotonic())

    def _write_counts(self, now: float) -> None:
        for count in self._limits.counts(now):
            self._write(count)

    def _write(self, entry: Entry) -> None:
        try:
            if self._missing.events:
                note = self._missing.note()
                self._write_one(note)
                self._missing = Missing()
                self._not_flushed.append(note)
            self._write_one(entry)
        except (OSError, ValueError):
            self._missing.add(entry)
            return
        self._not_flushed.append(entry)
        if len(self._not_flushed) >= MOST_TOGETHER:
            self._flush()

    def _flush(self) -> None:
        entries, self._not_flushed = self._not_flushed, []
        try:
            self._flush_all()
        except (OSError, ValueError):
            for entry in entries:
                self._missing.add(entry)
