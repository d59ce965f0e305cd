"""The log of an embedded gateway: that of Python, as seldom as the daemon logs; what handlers do wrong stays there."""

import logging

import pytest

from gateway import events
from gateway.events import LineLost
from gateway.library.log import EventLog
from gateway.observe import backlog

#: What was logged.
Records = list[logging.LogRecord]


@pytest.fixture
def records(logger) -> Records:
    found: Records = []
    logger.setLevel(logging.INFO)
    logger.addFilter(lambda record: found.append(record) or False)
    return found


def refused(client: str) -> events.AccessDenied:
    return events.AccessDenied("tcp", client, 41, 6)


def audit(*, was_sent: bool) -> events.WriteAudit:
    values = {"was_sent": was_sent, "client": "10.0.0.7:5", "result": "ok"}
    return events.WriteAudit(**{name: values.get(name) for name in events.WriteAudit.field_names})


def test_what_a_client_repeats_is_counted(records: Records) -> None:
    log = EventLog()
    for port in range(5000):
        log.emit(refused(f"10.0.0.7:{port}"))
    assert 0 < len(records) < 100


def test_each_write_that_was_sent_is_logged(records: Records) -> None:
    log = EventLog()
    for _ in range(300):
        log.emit(audit(was_sent=True))
    assert len(records) == 300
    assert records[0].event == audit(was_sent=True)


def test_how_many_more_there_were_is_said_with_a_later_event(records: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    log = EventLog()
    for _ in range(50):
        log.emit(refused("10.0.0.7:5001"))
    written = len(records)
    real = backlog.time.monotonic()
    monkeypatch.setattr("gateway.library.log.entry_of", lambda event: later(event, real + 100))
    log.emit(events.Stopped())
    count, _ = (record.getMessage() for record in records[written:])
    assert count == f"access_denied (listener tcp, client 10.0.0.7): {50 - written} more"


def test_what_was_counted_until_the_end_is_said_then(records: Records) -> None:
    log = EventLog()
    for _ in range(50):
        log.emit(refused("10.0.0.7:5001"))
    written = len(records)
    log.close()
    (count,) = (record.getMessage() for record in records[written:])
    assert count == f"access_denied (listener tcp, client 10.0.0.7): {50 - written} more"


def later(event: events.Event, at: float) -> backlog.Entry:
    return backlog.Entry(event.level, event.name, event.fields(), at=at)


LOST = LineLost("hall", "/dev/ttyUSB0", "unplugged")


@pytest.fixture
def logger():
    found = logging.getLogger("gateway")
    before = found.filters[:], found.handlers[:], found.level
    yield found
    found.filters, found.handlers = before[:2]
    found.setLevel(before[2])


def test_an_event_is_a_record_with_its_words_and_itself(logger):
    records = []
    logger.addFilter(lambda record: records.append(record) or False)
    EventLog().emit(LOST)
    logger.setLevel(logging.CRITICAL)
    EventLog().emit(LOST)
    (record,) = records
    assert (record.levelno, record.getMessage(), record.event) == (LOST.level, LOST.in_words(), LOST)


def test_a_filter_of_the_program_that_fails_reaches_no_line(logger, capsys, monkeypatch):
    logger.addFilter(lambda record: record.name_of_request)
    EventLog().emit(LOST)
    assert "has no attribute 'name_of_request'" in capsys.readouterr().err
    monkeypatch.setattr(logging, "raiseExceptions", False)
    EventLog().emit(LOST)
    assert capsys.readouterr().err == ""
