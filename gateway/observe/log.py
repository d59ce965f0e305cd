"""Events become log lines on standard error; structlog makes those for people."""

import json
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from gateway.events import Emit, Event, Level, WriteAudit
from gateway.observe.backlog import Entry
from gateway.observe.journal import JOURNAL, Journal, leads_to_journal
from gateway.observe.writer import StandardError, Stream, Writer

LogFormat = Literal["auto", "console", "json", "journald"]


@contextmanager
def open_log(level: str, log_format: LogFormat, stream: Stream | None = None) -> Iterator[Emit]:
    """In its context the function that logs events of `level` and above on `stream`, by default standard error.

    `console` is for people, with colours on a terminal unless NO_COLOR is set; `json` is one object a line; `journald`
    goes to systemd's journal, and is `console` where there is none. `auto` is `journald` where standard error leads to
    the journal, else `console`. What libraries log through Python's `logging` is written in the same way, from warnings
    on.

    The log never does harm: a thread writes it, at most ten lines a second about the same, one in ten seconds about
    clients of one address that are sent away, and one about writes of theirs that are refused, one a minute about what
    goes on for longer than that. Of what clients cause, each name has fifty lines in ten seconds. Accounts of other
    writes and errors of the service are not limited. What cannot be written is counted.
    """
    least = Level[level.upper()]
    writer = Writer(_sink(log_format, stream))

    def emit(event: Event) -> None:
        if event.level >= least:
            writer.put(_entry(event))

    root = logging.getLogger()
    before = root.handlers
    root.handlers = [_FromLibraries(max(least, Level.WARNING), writer)]
    try:
        yield emit
    finally:
        root.handlers = before
        writer.close()


def _sink(log_format: LogFormat, stream: Stream | None) -> Callable[[Entry], object]:
    """What writes an entry."""
    if log_format == "auto" and stream is None and leads_to_journal(2):
        log_format = "journald"
    if log_format == "journald" and Path(JOURNAL).exists():
        return Journal().write
    stream = StandardError() if stream is None else stream
    render = _as_json if log_format == "json" else _make_console_renderer(stream)
    return lambda entry: stream.write(render(entry))


def _entry(event: Event) -> Entry:
    audits = int(isinstance(event, WriteAudit))
    # Errors are rare, and somebody may have to account for each write; but anybody can have writes refused.
    limited = not event.was_sent if isinstance(event, WriteAudit) else event.level < Level.ERROR
    fields = event.fields()
    return Entry(time.monotonic(), time.time(), event.level, event.name, fields, limited, write_audits=audits)


class _FromLibraries(logging.Handler):
    """Takes what libraries log, asyncio above all."""

    def __init__(self, least: int, writer: Writer) -> None:
        super().__init__(least)
        self._writer = writer

    def emit(self, record: logging.LogRecord) -> None:
        """Log one record; its text is the field `message`."""
        fields = {"message": record.getMessage()}
        self._writer.put(Entry(time.monotonic(), time.time(), record.levelno, record.name, fields))


def _as_json(entry: Entry) -> str:
    stamp = datetime.fromtimestamp(entry.clock, UTC).isoformat().replace("+00:00", "Z")
    return json.dumps({**entry.fields, **_what_and_when(entry, stamp)}, default=repr) + "\n"


def _make_console_renderer(stream: Stream) -> Callable[[Entry], str]:
    import structlog  # noqa: PLC0415 - it is large, and a service has no use for it

    colors = stream.isatty() and "NO_COLOR" not in os.environ
    renderer = structlog.dev.ConsoleRenderer(colors=colors, pad_event_to=18)

    def render(entry: Entry) -> str:
        on_the_wall = datetime.fromtimestamp(entry.clock, UTC).astimezone()
        stamp = on_the_wall.isoformat(timespec="milliseconds")
        shown = {key: ", ".join(value) if isinstance(value, tuple) else value for key, value in entry.fields.items()}
        return f"{renderer(None, entry.name, {**shown, **_what_and_when(entry, stamp)})}\n"

    return render


def _what_and_when(entry: Entry, stamp: str) -> dict[str, str]:
    return {"event": entry.name, "level": logging.getLevelName(entry.level).lower(), "timestamp": stamp}
