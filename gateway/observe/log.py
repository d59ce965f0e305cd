"""Logs events on standard error; structlog formats the console output."""

import json
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

from gateway.events import Emit, Event, Level
from gateway.observe.backlog import Backlog, Entry, entry_of
from gateway.observe.journal import JOURNAL, Journal, leads_to_journal
from gateway.observe.printable import printable
from gateway.observe.writer import StandardError, Stream, Writer

_JSON: Final = json.JSONEncoder(default=repr)

LogFormat = Literal["auto", "console", "json", "journald"]


@contextmanager
def open_log(level: str, log_format: LogFormat, stream: Stream | None = None) -> Iterator[Emit]:
    """Yield a function that logs events of `level` and above on `stream`, by default standard error.

    `console` is readable text, with colours on a terminal unless NO_COLOR is set; `json` is one object a line;
    `journald` writes to systemd's journal, or like `console` if there is none. `auto` is `journald` if standard error
    is connected to the journal, else `console`. Warnings and errors that libraries log through Python's `logging` are
    written in the same way.

    Logging never blocks: a thread writes at most ten lines a second about the same subject; for each client address,
    one in ten seconds about rejected connections and one about refused writes; one a minute if that continues. Each
    event that clients can cause has fifty lines in ten seconds in total. Audits of other writes and errors of the
    service are not limited. Entries that cannot be written are counted.
    """
    least = Level[level.upper()]
    backlog = Backlog()
    writer = Writer(backlog, *_sink(log_format, stream))

    def emit(event: Event) -> None:
        if event.level >= least:
            backlog.add(entry_of(event))

    root = logging.getLogger()
    before = root.handlers
    root.handlers = [_FromLibraries(max(least, Level.WARNING), backlog)]
    try:
        yield emit
    finally:
        root.handlers = before
        writer.close()


def _sink(log_format: LogFormat, stream: Stream | None) -> tuple[Callable[[Entry], object], Callable[[], object]]:
    """Make the function that writes an entry, and the one that flushes."""
    if log_format == "auto" and stream is None and leads_to_journal(2):
        log_format = "journald"
    if log_format == "journald" and Path(JOURNAL).exists():
        return Journal().write, lambda: None
    stream = StandardError() if stream is None else stream
    render = _as_json if log_format == "json" else _make_console_renderer(stream)
    return lambda entry: stream.write(render(entry)), stream.flush


class _FromLibraries(logging.Handler):
    """Takes the log records of libraries, mainly asyncio."""

    def __init__(self, least: int, backlog: Backlog) -> None:
        super().__init__(least)
        self._backlog = backlog

    def emit(self, record: logging.LogRecord) -> None:
        """Log one record; its text is the field `message`."""
        self._backlog.add(Entry(record.levelno, record.name, {"message": record.getMessage()}))


def _as_json(entry: Entry) -> str:
    stamp = datetime.fromtimestamp(entry.clock, UTC).isoformat().replace("+00:00", "Z")
    return _JSON.encode({**entry.fields, **_what_and_when(entry, stamp)}) + "\n"


def _make_console_renderer(stream: Stream) -> Callable[[Entry], str]:
    import structlog  # noqa: PLC0415 - it is large, and a service does not need it

    colors = stream.isatty() and "NO_COLOR" not in os.environ
    renderer = structlog.dev.ConsoleRenderer(colors=colors, pad_event_to=18)

    def render(entry: Entry) -> str:
        on_the_wall = datetime.fromtimestamp(entry.clock, UTC).astimezone()
        stamp = on_the_wall.isoformat(timespec="milliseconds")
        told = {key: value for key, value in entry.fields.items() if value not in ("", (), None)}
        joined = {key: ", ".join(value) if isinstance(value, tuple) else value for key, value in told.items()}
        shown = {key: printable(value) if isinstance(value, str) else value for key, value in joined.items()}
        return f"{renderer(None, entry.name, {**shown, **_what_and_when(entry, stamp)})}\n"

    return render


def _what_and_when(entry: Entry, stamp: str) -> dict[str, str]:
    return {"event": entry.name, "level": logging.getLevelName(entry.level).lower(), "timestamp": stamp}
