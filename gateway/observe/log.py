"""Events become log lines on standard error, through structlog."""

import logging
import os
import sys
from collections.abc import Callable
from typing import Literal, TextIO

import structlog

from gateway.events import Emit, Event, Level

LogFormat = Literal["auto", "console", "json"]


def open_log(level: str, log_format: LogFormat, stream: TextIO = sys.stderr) -> Emit:
    """The function that writes events of `level` and above to `stream`.

    `console` is for people, with colours on a terminal unless NO_COLOR is set; `json` is one object a line; `auto` is
    `console`. What libraries log through Python's `logging` is written the same way, from warnings on. A log that
    cannot be written is given up silently: the gateway serves on.
    """
    logger = structlog.wrap_logger(
        structlog.PrintLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=log_format == "json"),
            *([structlog.processors.JSONRenderer()] if log_format == "json" else _for_people(stream)),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(Level[level.upper()]),
    )

    def write(urgency: int, name: str, **fields: object) -> None:
        try:
            logger.log(urgency, name, **fields)
        except (OSError, ValueError):
            return

    def emit(event: Event) -> None:
        write(event.level, event.name, **event.fields())

    logging.getLogger().handlers = [_FromLibraries(write)]
    return emit


class _FromLibraries(logging.Handler):
    """Takes what libraries log, asyncio above all."""

    def __init__(self, write: Callable[..., None]) -> None:
        super().__init__(logging.WARNING)
        self._write = write

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record; its text is the field `message`."""
        self._write(record.levelno, record.name, message=record.getMessage())


def _for_people(stream: TextIO) -> list[structlog.typing.Processor]:
    colors = stream.isatty() and "NO_COLOR" not in os.environ
    return [_lists_as_text, structlog.dev.ConsoleRenderer(colors=colors, pad_event_to=18)]


def _lists_as_text(_logger: object, _method: str, fields: structlog.typing.EventDict) -> structlog.typing.EventDict:
    return {key: ", ".join(value) if isinstance(value, tuple) else value for key, value in fields.items()}
