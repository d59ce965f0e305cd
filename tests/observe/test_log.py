"""How events look in the log, and that a log never does harm."""

import errno
import io
import json
import logging
import re
import time
from functools import partial
from threading import Event

import pytest

from gateway.events import (
    AccessDenied,
    ClientConnected,
    ClientRejected,
    CommandRefused,
    ConfigRejected,
    LineLost,
    QueueFull,
    Ready,
    RequestTimeout,
    WriteAudit,
)
from gateway.lines.counts import RESULTS
from gateway.observe.backlog import MOST_WAITING, MOST_WITH_RESERVE
from gateway.observe.limiter import Limiter
from gateway.observe.limits import MOST_CAUSED
from gateway.observe.log import open_log

LOST = LineLost("hall-a", "/dev/ttyUSB0", "unplugged")
TIMEOUT = RequestTimeout("hall-a", 1, "silo-1", 3, 1009.3, 1009.0, "gateway.toml:4")
#: So long the log may take, and in so many seconds a test says all that is about one subject.
PATIENCE, TOGETHER = 60.0, 3.0


@pytest.fixture(autouse=True)
def _on_a_busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.observe.writer.CLOSING_PATIENCE", PATIENCE)
    monkeypatch.setattr("gateway.observe.limits.Limiter", partial(Limiter, seconds=TOGETHER))


class SlowStream(io.StringIO):
    """Nobody reads it until it is `released`. `asked` once something is to be written."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = Event()
        self.released = Event()

    def write(self, text: str) -> int:
        self.asked.set()
        assert self.released.wait(PATIENCE)
        return super().write(text)


class FullDisk(io.StringIO):
    """Takes no line with this text until it `has_room`. `refused` once it has refused so many."""

    def __init__(self, count: int, text: str = "") -> None:
        super().__init__()
        self._left = count
        self._text = text
        self.refused = Event()
        self.has_room = False

    def write(self, text: str) -> int:
        if self.has_room or self._text not in text:
            return super().write(text)
        self._left -= 1
        if not self._left:
            self.refused.set()
        raise OSError(errno.ENOSPC, "No space left on device")


def written(register: int, result: str = "ok", client: str = "10.0.0.9:1") -> WriteAudit:
    return WriteAudit(client, "scada", 1, 6, register, 1, result, "", 1.0)


def logged(stream: io.StringIO) -> list[dict[str, object]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_json_is_one_object_a_line_with_the_fields_of_the_event() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        emit(LOST)
    (line,) = logged(stream)
    assert str(line.pop("timestamp")).endswith("Z")
    assert line == {
        "event": "line_lost", "level": "warning", "line": "hall-a", "port": "/dev/ttyUSB0", "reason": "unplugged",
    }  # fmt: skip


def test_console_is_plain_text_when_it_is_no_terminal() -> None:
    stream = io.StringIO()
    with open_log("info", "auto", stream) as emit:
        emit(Ready(("tcp://127.0.0.1:502", "tcp://[::1]:502"), 2, 1))
    (line,) = stream.getvalue().splitlines()
    assert "ready" in line
    assert "listeners='tcp://127.0.0.1:502, tcp://[::1]:502'" in line
    assert "\x1b" not in line


def test_control_characters_of_clients_do_not_reach_the_terminal() -> None:
    stream = io.StringIO()
    with open_log("info", "console", stream) as emit:
        emit(CommandRefused("mqtt", "s/\x1b[2J\x9b31m\u202eX/silo/set", "\x1b[1mno\x07"))
    (line,) = stream.getvalue().splitlines()
    assert line.isprintable()
    assert r"s/\x1b[2J\x9b31m\u202eX/silo/set" in line


def test_what_is_empty_is_left_out_for_people() -> None:
    stream = io.StringIO()
    with open_log("info", "console", stream) as emit:
        emit(WriteAudit("10.2.0.7:1", "scada", 41, 16, None, 0, "ok", "", 0.0))
    (line,) = stream.getvalue().splitlines()
    assert "unit=41" in line
    assert "count=0" in line
    assert not {"code", "role", "subject", "address"} & {word.partition("=")[0] for word in line.split()}


def test_people_get_the_time_on_their_wall_with_its_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "IST-5:30")
    time.tzset()
    try:
        stream = io.StringIO()
        with open_log("info", "console", stream) as emit:
            emit(LOST)
    finally:
        monkeypatch.undo()
        time.tzset()
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+05:30 ", stream.getvalue())


@pytest.mark.parametrize(("no_color", "colored"), [(None, True), ("1", False)])
def test_a_terminal_gets_colours_unless_no_color_is_set(
    monkeypatch: pytest.MonkeyPatch, no_color: str | None, colored: bool
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color:
        monkeypatch.setenv("NO_COLOR", no_color)
    stream = io.StringIO()
    stream.isatty = lambda: True  # type: ignore[method-assign]
    with open_log("info", "console", stream) as emit:
        emit(LOST)
    assert ("\x1b" in stream.getvalue()) is colored


def test_events_below_the_level_are_not_written() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        emit(ClientConnected("scada", "10.0.0.9:1"))
    with open_log("error", "json", stream) as emit:
        emit(LOST)
        logging.getLogger("asyncio").warning("slow")
    assert stream.getvalue() == ""


def test_what_libraries_log_is_written_the_same_way() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream):
        logging.getLogger("asyncio").warning("slow %s", "callback")
        logging.getLogger("asyncio").info("not worth a line")
    (line,) = logged(stream)
    assert (line["event"], line["level"], line["message"]) == ("asyncio", "warning", "slow callback")


def test_afterwards_the_logging_of_libraries_is_as_it_was() -> None:
    before = logging.getLogger().handlers
    with open_log("info", "json", io.StringIO()):
        assert logging.getLogger().handlers != before
    assert logging.getLogger().handlers == before


def test_a_log_that_cannot_be_written_is_given_up() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        stream.close()
        emit(LOST)


def test_what_a_full_disk_did_not_take_is_told_as_soon_as_it_has_room() -> None:
    stream = FullDisk(61)
    with open_log("info", "json", stream) as emit:
        for register in range(60):
            emit(written(register))
        emit(LOST)
        assert stream.refused.wait(PATIENCE)
        stream.has_room = True
        emit(written(60))
    note, last = logged(stream)
    assert (note["event"], note["dropped"], note["write_audits"]) == ("events_dropped", 61, 60)
    assert (last["event"], last["address"]) == ("write_audit", 60)


def test_a_count_that_a_full_disk_did_not_take_is_told_too() -> None:
    stream = FullDisk(1, "suppressed")
    with open_log("info", "json", stream) as emit:
        for _ in range(60):
            emit(TIMEOUT)
        assert stream.refused.wait(PATIENCE)
        emit(LOST)
    *_, note, lost = logged(stream)
    assert (note["event"], note["dropped"], note["write_audits"]) == ("events_dropped", 50, 0)
    assert lost["event"] == "line_lost"


def test_a_log_that_nobody_reads_stops_nobody_and_says_later_what_is_missing() -> None:
    stream = SlowStream()
    with open_log("info", "json", stream) as emit:
        emit(LOST)
        assert stream.asked.wait(PATIENCE)
        for unit in range(MOST_WAITING + 8):
            emit(RequestTimeout("hall-a", unit, "silo-1", 3, 1009.3, 1009.0, "gateway.toml:4"))
        stream.released.set()
    *told, last = logged(stream)
    assert [line.get("unit") for line in told] == [None, *range(MOST_WAITING)]
    assert (last["event"], last["dropped"]) == ("events_dropped", 8)


def test_what_is_missing_is_told_as_soon_as_the_log_is_read_again() -> None:
    stream = SlowStream()
    counted = Event()
    with open_log("info", "json", stream) as emit:
        emit(LOST)
        assert stream.asked.wait(PATIENCE)
        for register in range(MOST_WITH_RESERVE + 8):
            emit(written(register))
        stream.write = lambda text: counted.set() if "events_dropped" in text else None  # type: ignore[method-assign]
        stream.released.set()
        assert counted.wait(PATIENCE)


def test_the_end_does_not_wait_for_a_log_that_nobody_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.observe.writer.CLOSING_PATIENCE", 0.0)
    stream = SlowStream()
    with open_log("info", "json", stream) as emit:
        emit(LOST)
        assert stream.asked.wait(PATIENCE)
        emit(LOST)
    assert stream.getvalue() == ""
    stream.released.set()


def test_what_is_said_over_and_over_is_counted() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for _ in range(100):
            emit(TIMEOUT)
        emit(LOST)
    *told, lost, count = logged(stream)
    assert [line["event"] for line in told] == ["request_timeout"] * 10
    assert lost["event"] == "line_lost"
    del count["timestamp"]
    assert count == {"event": "request_timeout", "level": "warning", "line": "hall-a", "unit": 1, "suppressed": 90}


def test_a_count_has_all_that_its_events_stand_for() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for _ in range(20):
            emit(QueueFull("hall-a", 1, "press", "10.0.0.9:1", 7))
    *told, count = logged(stream)
    assert [line["times"] for line in told] == [7] * 10
    assert count["suppressed"] == 70


def test_clients_that_are_sent_away_are_worth_one_line_for_each_address() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for port in range(100):
            emit(ClientRejected("scada", f"10.0.0.9:{port}", f"an MBAP length of {port}"))
        emit(ClientRejected("scada", "10.0.0.7:1", "an MBAP length of 0"))
    assert [(line["client"], line.get("suppressed")) for line in logged(stream)] == [
        ("10.0.0.9:0", None), ("10.0.0.7:1", None), ("10.0.0.9", 99),
    ]  # fmt: skip


@pytest.mark.parametrize(("clients", "times"), [(700, 1), (50, 14)])
def test_what_many_clients_cause_has_a_limit_of_lines_too_and_none_goes_uncounted(clients: int, times: int) -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for number in range(clients * times):
            emit(AccessDenied("scada", f"10.0.{number % clients}.9:49152", 1, 6))
        emit(TIMEOUT)
    lines = logged(stream)
    told = [line for line in lines if line["event"] == "access_denied"]
    assert len(told) == MOST_CAUSED + 1  # a count
    assert sum(line.get("suppressed", 1) for line in told) == clients * times
    assert "client" not in told[-1]
    assert len(lines) == len(told) + 1


@pytest.mark.parametrize("result", ["ok", "exception", "broadcast", "timeout", "bad_frame", "ambiguous", "line_lost"])
def test_of_writes_that_may_have_been_carried_out_each_one_is_told(result: str) -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for register in range(150):
            emit(written(register, result))
    assert [line["address"] for line in logged(stream)] == [*range(150)]


REFUSED = {name for name in RESULTS if name not in ("ok", "exception", "broadcast")} | {"denied", "no_route", "stale"}
REFUSED -= {"timeout", "bad_frame", "ambiguous", "line_lost"}


@pytest.mark.parametrize("result", sorted(REFUSED))
def test_of_writes_that_were_refused_one_of_each_client_is_told_and_the_others_are_counted(result: str) -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for register in range(300):
            for host in ("10.0.0.7", "10.0.0.9"):
                emit(WriteAudit(f"{host}:{register}", "scada", register % 248, 6, register, 1, result, "01", 1.0))
    lines = [(line["event"], line["client"], line.get("suppressed")) for line in logged(stream)]
    assert lines == [
        ("write_audit", "10.0.0.7:0", None),
        ("write_audit", "10.0.0.9:0", None),
        ("write_audit", "10.0.0.7", 299),
        ("write_audit", "10.0.0.9", 299),
    ]


def test_a_count_of_refused_writes_hides_no_other_reason_behind_the_same_address() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for result in ("denied", "denied", "denied", "queue_full", "line_down", "queue_full"):
            emit(written(0, result))
    assert [(line["result"], line.get("suppressed")) for line in logged(stream)] == [
        ("denied", None), ("queue_full", None), ("line_down", None), ("denied", 2), ("queue_full", 1),
    ]  # fmt: skip


def test_unknown_clients_however_many_are_sent_away_hide_no_refused_write(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.observe.limiter.MOST_SUBJECTS", 20)
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for host in range(30):
            emit(ClientRejected("scada", f"10.1.0.{host}:49152", "access"))
        for host in ("10.0.0.7", "10.0.0.9"):
            emit(WriteAudit(f"{host}:49152", "scada", 1, 6, 0, 1, "line_down", "0B", 1.0))
    told = [line["client"] for line in logged(stream) if line["event"] == "write_audit"]
    assert told == ["10.0.0.7:49152", "10.0.0.9:49152"]


def test_refused_writes_however_many_leave_room_for_those_that_were_carried_out() -> None:
    stream = SlowStream()
    with open_log("info", "json", stream) as emit:
        emit(LOST)
        assert stream.asked.wait(PATIENCE)
        for register in range(3 * MOST_WAITING):
            emit(written(register, "denied"))
        for register in range(300):
            emit(written(register))
        stream.released.set()
    lines = logged(stream)
    assert [line["address"] for line in lines if line.get("result") == "ok"] == [*range(300)]
    (note,) = (line for line in lines if line["event"] == "events_dropped")
    assert (note["dropped"], note["write_audits"]) == (2 * MOST_WAITING, 2 * MOST_WAITING)
    assert [line.get("suppressed") for line in lines if line.get("client", "").startswith("10.0.0.9")] == [
        None, *(300 * [None]), MOST_WAITING - 1,
    ]  # fmt: skip


def test_the_count_comes_though_nothing_else_happens() -> None:
    stream = io.StringIO()
    counted = Event()
    stream.write = lambda text: counted.set() if "suppressed" in text else None  # type: ignore[method-assign]
    with open_log("info", "json", stream) as emit:
        for _ in range(11):
            emit(TIMEOUT)
        assert counted.wait(PATIENCE)


def test_errors_of_the_service_are_never_suppressed() -> None:
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for _ in range(30):
            emit(ConfigRejected("gateway.toml", "it has errors"))
    assert len(logged(stream)) == 30


class Together:
    """Keeps texts until `flush`, as standard error does, and what each flush has written; or refuses that."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.writes: list[str] = []
        self.first, self.refused = Event(), Event()
        self.is_full = False

    def write(self, text: str) -> None:
        self.texts.append(text)

    def flush(self) -> None:
        text, self.texts = "".join(self.texts), []
        if text and self.is_full:
            if '"address": 99' in text:
                self.refused.set()
            raise OSError(errno.ENOSPC, "No space left on device")
        if text:
            self.writes.append(text)
            self.first.set()

    def isatty(self) -> bool:
        return False


def test_a_line_is_written_at_once_and_those_that_follow_it_together(monkeypatch: pytest.MonkeyPatch) -> None:
    paused, go_on = Event(), Event()

    def pause(seconds: float) -> None:
        paused.set()
        assert go_on.wait(PATIENCE)

    monkeypatch.setattr("gateway.observe.writer.time.sleep", pause)
    stream = Together()
    with open_log("info", "json", stream) as emit:
        emit(written(0))
        assert stream.first.wait(PATIENCE)
        assert paused.wait(PATIENCE)
        for register in range(1, 101):
            emit(written(register))
        go_on.set()
    assert [text.count("\n") for text in stream.writes] == [1, 64, 36]
    assert [json.loads(line)["address"] for line in "".join(stream.writes).splitlines()] == [*range(101)]


def test_of_lines_that_could_not_be_written_together_each_one_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.observe.writer.time.sleep", lambda _: None)
    stream = Together()
    stream.is_full = True
    with open_log("info", "json", stream) as emit:
        for register in range(100):
            emit(written(register))
        assert stream.refused.wait(PATIENCE)
        stream.is_full = False
        emit(written(100))
    note, last = (json.loads(line) for line in "".join(stream.writes).splitlines())
    assert (note["event"], note["write_audits"], last["address"]) == ("events_dropped", 100, 100)


def test_a_flood_of_events_wakes_the_writer_now_and_then_only(monkeypatch: pytest.MonkeyPatch) -> None:
    pausing, go_on, pauses = Event(), Event(), []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        pausing.set()
        assert go_on.wait(PATIENCE)

    monkeypatch.setattr("gateway.observe.writer.time.sleep", pause)
    stream = io.StringIO()
    with open_log("info", "json", stream) as emit:
        for _ in range(2):
            emit(ClientRejected("scada", "10.0.0.1:1", "too many"))
        assert pausing.wait(PATIENCE)
        for _ in range(100):
            emit(ClientRejected("scada", "10.0.0.1:1", "too many"))
        emit(LOST)
        go_on.set()
    assert len(pauses) <= 2
    assert '"suppressed": 101' in stream.getvalue()
    assert "line_lost" in stream.getvalue()
