"""Events become log lines on standard error, through structlog."""

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
    `console`. A log that cannot be written is given up silently: the gateway serves on.
    """
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=log_format == "json"),
            _renderer(log_format, stream),
        ],
        logger_factory=structlog.PrintLoggerFactory(stream),
        cache_logger_on_first_use=True,
    )
    logger = structlog.get_logger()
    least = Level[level.upper()]
    writers: dict[Level, Callable[..., object]] = {each: getattr(logger, each.name.lower()) for each in Level}

    def emit(event: Event) -> None:
        if event.level < least:
            return
        try:
            writers[event.level](event.name, **event.fields())
        except (OSError, ValueError):
            return

    return emit


def _renderer(log_format: LogFormat, stream: TextIO) -> structlog.typing.Processor:
    if log_format == "json":
        return structlog.processors.JSONRenderer()
    colors = stream.isatty() and "NO_COLOR" not in os.environ
    return structlog.dev.ConsoleRenderer(colors=colors, pad_event_to=18)
