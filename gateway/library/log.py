"""Hands events to Python's logging, as any library does: the program decides what becomes of them."""

import logging
from typing import Final

from gateway.events import Event

_LOGGER: Final = logging.getLogger("gateway")


def log_event(event: Event) -> None:
    """Log an event in words, with its fields as `extra`, to the logger `gateway`."""
    if _LOGGER.isEnabledFor(event.level):
        _LOGGER.log(event.level, "%s", event.in_words() or event, extra={"event": event})
