"""How events look in systemd's journal. What journald makes of them is seen in tests/system."""

import os
from struct import pack

import pytest

from gateway.events import Level
from gateway.observe.backlog import Entry
from gateway.observe.journal import encode, leads_to_journal


def encoded(level: int = Level.INFO, name: str = "ready", **fields: object) -> list[bytes]:
    return encode(Entry(level, name, fields)).splitlines()


def test_each_field_of_an_event_is_a_field_of_the_journal():
    assert encoded(Level.WARNING, "request_timeout", line="hall-a", unit=46, limit_ms=1009.0) == [
        b"MESSAGE=request_timeout line=hall-a unit=46 limit_ms=1009.0",
        b"PRIORITY=4",
        b"SYSLOG_IDENTIFIER=modbus-gateway",
        b"MODBUS_EVENT=request_timeout",
        b"MODBUS_LINE=hall-a",
        b"MODBUS_UNIT=46",
        b"MODBUS_LIMIT_MS=1009.0",
    ]


def test_levels_become_priorities():
    levels = (50, Level.ERROR, Level.WARNING, Level.INFO, Level.DEBUG, 5)
    assert [encoded(level)[1] for level in levels] == [b"PRIORITY=%d" % number for number in (2, 3, 4, 6, 7, 7)]


def test_several_values_stand_in_one_field():
    assert b"MODBUS_LISTENERS=tcp://127.0.0.1:502, tcp://[::1]:502" in encoded(
        listeners=("tcp://127.0.0.1:502", "tcp://[::1]:502")
    )


def test_a_value_of_several_lines_stands_behind_its_length_and_not_in_the_message():
    data = encode(Entry(Level.ERROR, "part_failed", {"part": "line a", "traceback": "one\ntwo"}))
    assert data.startswith(b"MESSAGE=part_failed part=line a\n")
    assert data.endswith(b"MODBUS_TRACEBACK\n" + pack("<Q", 7) + b"one\ntwo\n")


@pytest.mark.parametrize(
    ("client", "address"), [("10.2.0.7:49152", b"10.2.0.7"), ("[fe80::7%eth0]:49152", b"fe80::7%eth0")]
)
def test_all_that_is_about_one_machine_can_be_found(client: str, address: bytes) -> None:
    assert b"MODBUS_CLIENT_ADDRESS=" + address in encoded(client=client)


def test_a_client_on_a_line_has_no_address():
    assert not any(field.startswith(b"MODBUS_CLIENT_ADDRESS") for field in encoded(client="panel"))


def test_what_is_no_text_is_written_all_the_same():
    assert b"MODBUS_REASON=\\udcff" in encoded(reason="\udcff")


def test_a_stream_leads_to_the_journal_when_systemd_says_so(tmp_path):
    with (tmp_path / "stream").open("wb") as stream:
        found = os.fstat(stream.fileno())
        environment = {"JOURNAL_STREAM": f"{found.st_dev}:{found.st_ino}"}
        assert leads_to_journal(stream.fileno(), environment)
        assert not leads_to_journal(stream.fileno(), {})
        assert not leads_to_journal(stream.fileno(), {"JOURNAL_STREAM": "1:2"})
    assert not leads_to_journal(12345, environment)
