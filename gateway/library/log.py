"""Hands events to Python's logging, as any library does: the program decides what becomes of them."""

import logging
from math import inf
from threading import RLock
from traceback import print_exc
from typing import Final

from gateway.events import Event
from gateway.observe.backlog import entry_of
from gateway.observe.limits import Limits

_LOGGER: Final = logging.getLogger("gateway")


class EventLog:
    """Logs events in words to the logger `gateway`, each as `extra`; about the same thing as often as the daemon does.

    How many more there were is logged with the next event, once it is due, and by `close`. Any thread may `emit`. What
    a filter or handler of the program raises is printed, as `logging` does where it can: it must not reach a line.
    """

    def __init__(self) -> None:
        self._limits = Limits()
        # Reentrant: what the garbage collector runs may cause an event.
        self._lock = RLock()

    def emit(self, event: Event) -> None:
        """Log an event, or count it."""
        if not _LOGGER.isEnabledFor(event.level):
            return
        entry = entry_of(event)
        self._log_counts(entry.at)
        with self._lock:
            is_admitted = self._limits.admit(entry)
        if is_admitted:
            _log(event.level, event.in_words() or str(event), event)

    def close(self) -> None:
        """Log the counts that are not due yet."""
        self._log_counts(inf)

    def _log_counts(self, now: float) -> None:
        with self._lock:
            counts = list(self._limits.counts(now))
        for count in counts:
            about = ", ".join(f"{key} {value}" for key, value in count.fields.items() if key != "suppressed")
            _log(count.level, f"{count.name} ({about}): {count.events} more")


def _log(level: int, text: str, event: Event | None = None) -> None:
    try:
        _LOGGER.log(level, "%s", text, extra={"event": event})
    except Exception:  # noqa: BLE001 - of the program's logging
        if logging.raiseExceptions:
            print_exc()
