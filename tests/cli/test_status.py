"""`status`: what it prints of the daemon's answer, also of one of another version."""

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.lines.counts import Counts
from gateway.service.status import ListenerStatus, MirrorStatus, RangeStatus, Status, UnitStatus

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
    last_error="timeout",
    longest_wait_ms=3151.0,
    counts=replace(Counts(), sent=7, ok=4, timeout=3),
    exceptions={},
    functions={},
)
STATUS = Status(
    at=1.0,
    listeners=(ListenerStatus("scada", "tcp://127.0.0.1:5020", 1, 2, 0, 0, 0),),
    lines=(),
    servers=(),
    upstreams=(),
    units=(UNIT, replace(UNIT, unit=42, state="fine", counts=Counts())),
    images=(),
    mirrors=(MirrorStatus(241, "m", "", "silo", 5, 0, 9, 0, (RangeStatus("holding 0-1", 500.0, 1234.0),)),),
)
LISTENERS = [
    "Listeners",
    "  NAME   ADDRESS               CLIENTS  REJECTED",
    "  scada  tcp://127.0.0.1:5020  1        0",
]


def as_told(status: Status) -> Any:
    """As it comes out of the control socket."""
    return json.loads(json.dumps(asdict(status)))


def shown(status: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    answer = {"ok": True, "status": status}
    monkeypatch.setattr("gateway.cli.status.ask", lambda verb, control: answer)
    assert main(["status"]) == FINE
    return capsys.readouterr().out.splitlines()


def test_the_status_of_a_daemon_of_this_version(monkeypatch, capsys) -> None:
    assert shown(as_told(STATUS), monkeypatch, capsys) == [
        *LISTENERS,
        "",
        "Units",
        "  UNIT  AT        DEVICE  STATE      OK  FAILED  LAST-ERROR  LONGEST-WAIT",
        "  41    hall-a/1  silo    rests 2 s  4   3       timeout     3.16 s",
        "",
        "Mirrors",
        "  UNIT  NAME  OF    REQUESTS  AGES",
        "  241   m     silo  5         holding 0-1: 1.2 s",
        "",
        "1 units have not been asked yet.",
    ]


def test_what_an_older_daemon_does_not_tell_is_unknown(monkeypatch, capsys) -> None:
    older = as_told(STATUS)
    del older["mirrors"], older["units"][0]["longest_wait_ms"], older["units"][0]["counts"]["timeout"]
    del older["units"][1]
    assert shown(older, monkeypatch, capsys) == [
        *LISTENERS,
        "",
        "Units",
        "  UNIT  AT        DEVICE  STATE      OK  FAILED  LAST-ERROR  LONGEST-WAIT",
        "  41    hall-a/1  silo    rests 2 s  4   0       timeout     unknown",
        "",
        "Mirrors",
        "  unknown",
    ]


def test_what_a_newer_daemon_tells_besides_is_passed_over(monkeypatch, capsys) -> None:
    newer = as_told(STATUS)
    before = shown(newer, monkeypatch, capsys)
    newer["fleet"] = [{"site": "plant"}]
    newer["units"][0] |= {"trend": [1, 2]}
    newer["units"][0]["counts"]["unheard_of"] = 3
    assert shown(newer, monkeypatch, capsys) == before


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    for key, inner in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(inner, (dict, list)):
            yield from _places(inner)


@pytest.mark.parametrize("instead", [None, 7, "text", [], {}, "nothing at all"])
def test_no_key_is_missed_and_no_kind_of_value_is_relied_on(monkeypatch, capsys, instead) -> None:
    count = len(list(_places(as_told(STATUS))))
    for number in range(count):
        status = as_told(STATUS)
        table, key = list(_places(status))[number]
        if instead == "nothing at all":
            del table[key]
        else:
            table[key] = instead
        assert shown(status, monkeypatch, capsys)


@pytest.mark.parametrize("answer", [{"ok": True}, {"ok": True, "status": []}])
def test_an_answer_without_a_status_is_a_problem_in_plain_words(monkeypatch, capsys, answer) -> None:
    monkeypatch.setattr("gateway.cli.status.ask", lambda verb, control: answer)
    assert main(["status"]) == PROBLEM_FOUND
    assert "the daemon's answer has no status in it" in capsys.readouterr().err
