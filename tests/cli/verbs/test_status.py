"""`status`: what it prints of the daemon's answer, also of one of another version."""

import json
from dataclasses import asdict, replace
from typing import Any

import pytest

from gateway.cli.kit.cells import width_of
from gateway.cli.kit.paint import plain
from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.cli.show.status import show_status, status_screen
from gateway.lines.counts import Counts
from gateway.operator.operations.answers.status import (
    ClientStatus,
    LineStatus,
    LineUserStatus,
    ListenerStatus,
    MirrorStatus,
    MovedStatus,
    RangeStatus,
    SourceStatus,
    Status,
    TimesStatus,
    UnitStatus,
    VirtualStatus,
)
from gateway.operator.operations.answers.trouble import Trouble
from gateway.plant.status import BrokerStatus, KeptStatus
from gateway.timing.measured import Phases
from kit.control import telling

TIMES = TimesStatus(0.4, 2.0, 12.3, 45.0, 0.05, 0.18, 250.4, 0)
UNIT = UnitStatus(
    line="hall-a",
    unit=41,
    on_the_wire=1,
    name="silo",
    source="gateway.toml:3",
    profile="generic",
    state="resting",
    failures=3,
    rests_ms=1500.0,
    last_answer_ms=200_000.0,
    last_error="timeout",
    last_error_ms=3000.0,
    longest_wait_ms=3151.0,
    counts=replace(Counts(), sent=7, ok=4, timeout=3),
    times=TIMES,
    exceptions={},
    functions={},
    function_times={3: TIMES},
)
LINE = LineStatus(
    name="hall-a",
    source="gateway.toml:1",
    port="/dev/ttyUSB0",
    state="up",
    reason="",
    wire="serial",
    mode="rtu",
    baud=19200,
    format="8E1",
    queue=2,
    late_windows=0,
    busy_s=12.3,
    busy_share=0.634,
    requests_per_s=12.44,
    phases=Phases(1, 2, 3, 4),
    unasked_bytes=0,
    counts=replace(Counts(), sent=7, ok=4, timeout=3),
    users=(),
)
STATUS = Status(
    at=1.0,
    listeners=(ListenerStatus("scada", "tcp://127.0.0.1:5020", 1, 2, 0, 0, 0),),
    clients=(ClientStatus("10.0.0.9:49152", "scada", 1000.0, 12, 1),),
    rejections=(),
    lines=(LINE,),
    servers=(),
    upstreams=(),
    units=(UNIT, replace(UNIT, unit=42, name="press", state="fine", counts=Counts())),
    images=(),
    mirrors=(MirrorStatus(241, "m", "", "silo", 5, 0, 9, 0, (RangeStatus("holding 0-1", 500.0, 1234.0),)),),
    virtual=(
        VirtualStatus(
            *(240, "block", "", 7, 2, 30, 4, None),
            (SourceStatus("silo", 2, 2, 1234.0), SourceStatus("press", 1, 0, None)),
        ),
    ),
)
LINES = [
    "Lines (busy and requests/s: of the last minute)",
    "  NAME    PORT          SPEED      STATE  BUSY  REQ/S  WAITING  ERRORS",
    "  hall-a  /dev/ttyUSB0  19200 8E1  up     63 %  12.4   2        3",
    "",
]
LISTENERS = [
    "Listeners",
    "  NAME   ADDRESS               CLIENTS  REJECTED",
    "  scada  tcp://127.0.0.1:5020  1        0",
    "",
    "Clients",
    "  CLIENT          LISTENER  LAST",
    "  10.0.0.9:49152  scada     1 s",
    "",
]
NOTES = [
    "Notes",
    "  unit 41, silo: rests, next try in 2 s; timeout: check its power, wiring and",
    "    address",
]


def as_told(status: Status) -> Any:
    """As it comes out of the control socket."""
    return json.loads(json.dumps(asdict(status)))


def notes(**unit: Any) -> str:
    """What is noted about a unit like this."""
    text = show_status(replace(STATUS, units=(replace(UNIT, **unit),)), 200)
    return text.partition("Notes\n")[2].strip()


def test_of_a_unit_that_is_silent_where_it_moved_to_it_says_how_to_ask_where_the_config_says() -> None:
    def noted(failures: int) -> str:
        moved = MovedStatus("hall-a", 41, "silo", (5,), 3, failures)
        return show_status((replace(STATUS, moved=(moved,))), 200)

    said = "unit 41, silo: does not answer where it moved to; if it is at 3 again: modbus-gateway forget silo"
    assert said in noted(failures=1)
    assert "forget" not in noted(failures=0)


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


def shown(status: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    monkeypatch.setattr("gateway.cli.verbs.status.Conversation", telling({"status": status}))
    assert main(["status"]) == FINE
    return capsys.readouterr().out.splitlines()


def test_the_status_of_a_daemon_of_this_version(monkeypatch, capsys) -> None:
    assert shown(as_told(STATUS), monkeypatch, capsys) == [
        *LINES,
        "Units (answer times in ms)",
        "  UNIT  AT        DEVICE  STATE    LAST   P50  P99  LIMIT  ANSWERED  MAX-WAIT",
        "  41    hall-a/1  silo    resting  3 min  12   45   250    57 %      3.16 s",
        "",
        "Mirrors",
        "  UNIT  NAME  OF    REQUESTS  AGES",
        "  241   m     silo  5         holding 0-1: 1.2 s",
        "",
        "Virtual units",
        "  UNIT  NAME   SOURCES       REQUESTS  EXCEPTIONS  POLLS FAILED  OLDEST",
        "  240   block  1 of 2 fresh  7         2           4             not known",
        "",
        *LISTENERS,
        *NOTES,
        "",
        "1 unit has not been asked yet.",
    ]


def test_what_an_older_daemon_does_not_tell_has_its_default(monkeypatch, capsys) -> None:
    older = as_told(STATUS)
    expected = shown(as_told(STATUS), monkeypatch, capsys)
    del older["brokers"], older["site"], older["lines"][0]["counts"]["explained"]
    assert shown(older, monkeypatch, capsys) == expected


def test_a_status_without_what_has_no_default_is_not_understood(monkeypatch, capsys) -> None:
    older = as_told(STATUS)
    del older["units"][1]["longest_wait_ms"]
    monkeypatch.setattr("gateway.cli.verbs.status.Conversation", telling({"status": older}))
    assert main(["status"]) == PROBLEM_FOUND
    assert "is not understood ('status.units[1].longest_wait_ms' is missing); " in capsys.readouterr().err


def test_json_is_passed_on_as_it_is_told(monkeypatch, capsys) -> None:
    other = {"units": 3, "new": [None]}
    monkeypatch.setattr("gateway.cli.verbs.status.Conversation", telling({"status": other}))
    assert main(["status", "--json"]) == FINE
    assert json.loads(capsys.readouterr().out) == other


def test_what_a_newer_daemon_tells_besides_is_passed_over(monkeypatch, capsys) -> None:
    newer = as_told(STATUS)
    before = shown(newer, monkeypatch, capsys)
    newer["fleet"] = [{"site": "plant"}]
    newer["units"][0] |= {"trend": [1, 2]}
    newer["units"][0]["counts"]["unheard_of"] = 3
    assert shown(newer, monkeypatch, capsys) == before


@pytest.mark.parametrize("answer", [{}, {"status": []}])
@pytest.mark.parametrize("words", ["status", "status --fleet"])
def test_an_answer_without_a_status_is_a_problem_in_plain_words(monkeypatch, capsys, answer, words) -> None:
    monkeypatch.setattr("gateway.cli.verbs.status.Conversation", telling(answer))
    assert main(words.split()) == PROBLEM_FOUND
    assert "the gateway's answer is not understood ('s" in capsys.readouterr().err


def test_long_names_are_shortened_to_80_characters_and_keep_their_ends(monkeypatch, capsys) -> None:
    port = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"
    unit = replace(UNIT, name="weighing cell behind the second silo", line="building-7-hall-a", on_the_wire=247)
    long = replace(STATUS, lines=(replace(LINE, port=port, busy_share=1.0, requests_per_s=123.4),), units=(unit,))
    rows = shown(as_told(long), monkeypatch, capsys)
    assert max(map(len, rows)) <= 80
    assert "BI-if00-port0" in rows[2]
    assert "/247  " in rows[6]


def test_names_are_whole_in_a_pipe(monkeypatch, capsys) -> None:
    monkeypatch.delenv("COLUMNS")
    name = "weighing cell behind the second silo"
    rows = shown(as_told(replace(STATUS, units=(replace(UNIT, name=name, line=50 * "x"),))), monkeypatch, capsys)
    assert [row for row in rows if f"  {50 * 'x'}/1  {name}  " in row]


def test_a_unit_that_has_never_answered_in_time_is_not_fine() -> None:
    def row(**counts: int) -> str:
        unit = replace(UNIT, state="fine", counts=Counts(**counts))
        return plain(show_status(replace(STATUS, units=(unit,)))).partition("MAX-WAIT\n")[2].partition("\n")[0]

    assert "  failing  " in row(sent=4, timeout=2, line_lost=2)
    assert "  fine  " in row(sent=4, timeout=3, ok=1)


def test_what_many_take_together_has_no_function() -> None:
    others = LineUserStatus("others", 0, "", 0, 0.5, 3.0)
    text = show_status(replace(STATUS, lines=(replace(LINE, users=(others,)),)))
    assert ["hall-a", "others", "-", "-", "50.0", "%", "3.0"] in [row.split() for row in text.splitlines()]


def test_of_a_unit_behind_a_server_doctor_looks_for_the_reason() -> None:
    behind = {"line": "roof", "name": "inverter", "state": "failing"}
    assert notes(**behind) == "unit 41, inverter: timeout, 3 in a row: modbus-gateway doctor roof looks for the reason"


def test_a_table_that_is_too_wide_in_any_case_is_not_shortened(monkeypatch, capsys) -> None:
    refused = "Connection refused"
    broker = BrokerStatus("mqtt://127.0.0.1:5883", "", "down", refused, 9.0, "5", 1, 2, 0, 3, 0, 0, 0, 0, 0, 0)
    rows = shown(as_told(replace(STATUS, brokers=(broker,))), monkeypatch, capsys)
    [row] = [row for row in rows if broker.broker in row]
    assert refused in row


def test_what_is_kept_for_a_broker_has_a_table(monkeypatch, capsys) -> None:
    broker = BrokerStatus("mqtt://b", "", "down", "refused", 9.0, "5", 1, 2, 0, 3, 0, 0, 0, 0, 0, 0)
    kept = KeptStatus(12340, "2026-05-01T10:05:00Z", 1_200_000.0, 3 * 2**20, 64 * 2**20, 10_800_000.0, 7, 5000.0, "")
    rows = shown(as_told(replace(STATUS, brokers=(replace(broker, kept=kept),))), monkeypatch, capsys)
    place = rows.index("Kept for the broker")
    assert rows[place + 1].split() == ["VALUES", "OLDEST", "DISK", "FULL", "IN", "GIVEN", "UP", "TROUBLE"]
    assert rows[place + 2].split() == ["12340", "20", "min", "3.0/64", "MiB", "3", "h", "7", "-"]
    assert "Kept for the broker" not in shown(as_told(replace(STATUS, brokers=(broker,))), monkeypatch, capsys)


def test_no_command_in_a_note_is_broken_in_its_middle() -> None:
    unit = replace(UNIT, line="roof", name="inverter", last_error="bad_frame", counts=Counts(sent=9, bad_frame=9))
    for width in range(60, 100):
        assert "modbus-\n" not in show_status(replace(STATUS, units=(unit,)), width)


def test_a_unit_that_is_fine_needs_no_note() -> None:
    assert notes(state="fine", counts=Counts(sent=100, ok=100, responses=100)) == ""
    assert notes(state="fine", counts=Counts(sent=100, ok=98, timeout=2, responses=98)) == ""


def test_a_unit_close_to_its_limit_gets_the_line_to_edit() -> None:
    slow = replace(TIMES, limit_share_p99=0.93)
    many = Counts(sent=100, ok=100, responses=100)
    assert notes(state="fine", times=slow, counts=many) == (
        "unit 41, silo: close to its limit (93%): modbus-gateway doctor says how to give it more time (gateway.toml:3)"
    )
    few = Counts(sent=10, ok=10, responses=10)
    assert notes(state="fine", times=slow, counts=few) == ""
    assert "2 responses came after the limit: modbus-gateway doctor says how" in notes(
        state="fine", times=replace(slow, late=2), counts=many
    )


def test_a_limit_that_is_far_too_long_is_told_once_it_has_cost_the_line_something() -> None:
    quick = TimesStatus(0.4, 2.0, 12.3, 20.0, 0.01, 0.03, 1005.0, 0)
    counts = Counts(sent=400, ok=399, timeout=1, responses=399)
    assert notes(state="fine", times=quick, counts=counts) == (
        "unit 41, silo: each request without a response stops its line for 1 s, which is 50 times what it needs: "
        "modbus-gateway calibrate silo finds a shorter limit"
    )
    assert notes(state="fine", times=quick, counts=replace(counts, ok=400, timeout=0)) == ""
    assert notes(state="fine", times=quick, counts=replace(counts, responses=99)) == ""
    assert notes(state="fine", times=replace(quick, limit_ms=400.0), counts=counts) == ""
    assert notes(state="fine", times=replace(quick, limit_share_p99=0.06), counts=counts) == ""


def test_a_unit_that_fails_says_what_to_check() -> None:
    assert "bad_frame, 2 in a row: check baud rate" in notes(state="failing", failures=2, last_error="bad_frame")
    lossy = Counts(sent=100, ok=90, timeout=10, responses=90)
    assert "10 requests failed; last was timeout, 3 s ago: check its power" in notes(state="fine", counts=lossy)


def test_what_its_profile_forbids_is_no_failure_of_a_unit(monkeypatch, capsys) -> None:
    healthy = replace(UNIT, state="fine", failures=0, counts=Counts(sent=5, ok=5, refused=10, unwanted=1))
    text = "\n".join(shown(as_told(replace(STATUS, units=(healthy,))), monkeypatch, capsys))
    assert "100 %" in text
    assert "requests failed" not in text


def test_a_unit_that_was_only_asked_what_its_profile_forbids_is_shown(monkeypatch, capsys) -> None:
    refused = replace(UNIT, state="fine", failures=0, counts=Counts(refused=10))
    assert any("silo" in line for line in shown(as_told(replace(STATUS, units=(refused,))), monkeypatch, capsys))


def test_whole_frames_in_place_of_responses_say_nothing_against_rate_and_wiring() -> None:
    counts = replace(Counts(), sent=9, bad_frame=9, foreign_frames=18)
    shown = notes(state="failing", failures=9, last_error="bad_frame", counts=counts)
    assert "bad_frame, 9 in a row: what came was probably other traffic: check its power" in shown


@pytest.mark.parametrize(("last_ms", "told"), [(3000.0, ", 3 s ago"), (720_000.0, ", 12 min ago"), (None, "")])
def test_how_long_ago_a_unit_failed_last_is_told(last_ms, told) -> None:
    lossy = Counts(sent=100, ok=90, timeout=10, responses=90)
    said = notes(state="fine", counts=lossy, last_error_ms=last_ms)
    assert f"10 requests failed; last was timeout{told}: check its power" in said


def test_one_request_that_failed_is_one_request() -> None:
    assert "1 request failed;" in notes(state="fine", counts=Counts(sent=10, ok=9, timeout=1))


def test_a_line_says_why_it_is_down_and_that_it_is_too_busy(monkeypatch, capsys) -> None:
    down = replace(LINE, state="down", reason="/dev/ttyUSB0 does not exist", busy_share=None, requests_per_s=None)
    busy = replace(LINE, name="hall-b", busy_share=0.97)
    text = plain(show_status(replace(STATUS, lines=(down, busy), units=()), 100))
    assert "hall-a: down: /dev/ttyUSB0 does not exist" in text
    assert "hall-b: busy for 97% of the time: poll less often or raise the baud rate" in text
    assert "  down   -     -  " in text


USER = LineUserStatus("10.2.0.7", 1, "silo", 3, 0.6214, 10.5)


def test_who_takes_a_line_up_is_shown():
    users = (USER, replace(USER, client="control", share=0.01), USER, replace(USER, client="left out"))
    said = show_status(replace(STATUS, lines=(replace(LINE, users=users),)))
    assert "Users of the lines (of the last minute)\n" in said
    assert "  LINE    CLIENT    UNIT  DEVICE  FUNCTION  SHARE   REQ/S\n" in said
    assert "  hall-a  10.2.0.7  41    silo    3         62.1 %  10.5\n" in said
    assert "left out" not in said


def test_a_line_that_is_full_says_by_whom():
    full = replace(LINE, busy_share=0.95, users=(USER,))
    said = " ".join(show_status(replace(STATUS, lines=(full,))).split())
    assert "busy for 95% of the time (62% by 10.2.0.7: silo, function 3): poll less often" in said


DOWN = replace(LINE, name="hall-b", state="down", reason="/dev/ttyUSB1 does not exist", busy_share=None)
TROUBLES = (
    Trouble("failing", "units", "silo", "hall-a", "timeout", 0.43, 7),
    Trouble("down", "", "broker mqtt://plant", reason="Connection refused"),
    Trouble("down", "lines", "hall-b", reason="/dev/ttyUSB1 does not exist"),
    Trouble("failing", "units", "press", "hall-a", "timeout", 0.43, 7),
    Trouble("full", "lines", "hall-a", share=0.86),
)
BAD = replace(STATUS, lines=(LINE, DOWN), troubles=TROUBLES)


def test_what_is_wrong_stands_first_and_the_worst_of_it_above(monkeypatch, capsys) -> None:
    rows = shown(as_told(BAD), monkeypatch, capsys)
    assert rows[:12] == [
        "What is wrong",
        "  broker mqtt://plant: down: Connection refused",
        "  hall-b: down: /dev/ttyUSB1 does not exist",
        "  hall-a: busy for 86% of the time",
        "  unit 41, silo: rests, next try in 2 s; timeout: check its power, wiring and",
        "    address",
        "  unit 42, press: 43% of 7 requests without an answer in the last minutes; last",
        "    was timeout",
        "",
        "Lines (busy and requests/s: of the last minute)",
        "  NAME    PORT          SPEED      STATE  BUSY  REQ/S  WAITING  ERRORS",
        "  hall-b  /dev/ttyUSB0  19200 8E1  down   -     12.4   2        3",
    ]
    assert "Notes" not in rows


def test_what_is_told_of_a_trouble_is_no_note_besides() -> None:
    assert "Notes" in show_status(STATUS)
    text = plain(show_status(replace(STATUS, troubles=TROUBLES[:1])))
    assert text.startswith("What is wrong\n  unit 41, silo: rests, next try in 2 s; ")
    assert "Notes" not in text


def test_a_rejected_config_is_told_with_the_command_that_says_why() -> None:
    text = plain(show_status(replace(STATUS, troubles=(Trouble("fix", "", "config", reason="rejected"),))))
    assert text.startswith("What is wrong\n  config: rejected; modbus-gateway check says why\n")


def test_one_line_has_its_units_and_what_shows_their_values() -> None:
    other = replace(UNIT, line="hall-b", name="mixer", unit=43)
    whole = replace(BAD, units=(*BAD.units, other), mirrors=(*BAD.mirrors,))
    screen = status_screen(whole, 80, "hall-b")
    text = plain("\n".join(screen.lines))
    assert screen.parts == ["hall-a", "hall-b"]
    assert "mixer" in text
    assert "silo" not in text
    assert "scada" not in text
    assert "silo" in plain("\n".join(status_screen(whole, 80, "hall-a").lines))
    assert plain(screen.wrong[2]) == "  hall-b: down: /dev/ttyUSB1 does not exist"
    assert status_screen(whole, 80, "gone") == status_screen(whole, 80)


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_line_of_what_is_wrong_is_longer_than_the_screen(width: int) -> None:
    path = Trouble("down", "", "broker " + 90 * "x", reason="a reason " + 30 * "\u5bbd")
    for line in status_screen(replace(BAD, troubles=(*TROUBLES, path)), width).wrong:
        assert width_of(line) <= width


def test_states_have_colours(monkeypatch, capsys) -> None:
    monkeypatch.setattr("gateway.cli.verbs.status.Conversation", telling({"status": as_told(BAD)}))
    assert main(["status", "--color", "always"]) == FINE
    out = capsys.readouterr().out
    assert "\x1b[31mdown\x1b[0m" in out
    assert "\x1b[31mresting\x1b[0m" in out
    assert "\x1b[31mhall-b\x1b[0m: down: " in out
