"""`events`: what is printed, what the gateway is asked for, and how following it ends."""

import json
import time
from collections.abc import Iterator

import pytest

from gateway.cli.kit.daemon import GatewayGoneError
from gateway.cli.kit.paint import red, yellow
from gateway.cli.main import FINE, INTERRUPTED, PROBLEM_FOUND, WRONG_USAGE, main
from gateway.cli.verbs import events
from gateway.errors import DaemonError
from kit.control import FakeConversation, telling

LOST = {
    "line": "hall",
    "timestamp": "2026-05-01T12:00:00.000Z",
    "event": "line_lost",
    "level": "warning",
    "text": "line hall is down: unplugged",
    "times": 1,
    "since": "2026-05-01T12:00:00.000Z",
    "number": 3,
}
COUNTED = {**LOST, "timestamp": "2026-05-01T12:30:05.000Z", "times": 57}
OTHER = {**LOST, "number": 4, "event": "line_up", "level": "info", "text": "line hall is up\x1b[2J"}


@pytest.fixture(autouse=True)
def _zone(monkeypatch):
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.fixture
def daemon(monkeypatch):
    """A gateway with one event."""
    daemon = telling({"events": [LOST], "next": 7})
    monkeypatch.setattr(events, "Conversation", daemon)
    return daemon


def following(monkeypatch, *answers: list[dict], end: BaseException) -> FakeConversation:
    """A gateway with these events, one list at a look, and then this end."""
    monkeypatch.setattr(events, "_STEP", 0.0)
    coming: Iterator[list[dict]] = iter(answers)

    def answer(_):
        try:
            found = next(coming)
        except StopIteration:
            raise end from None
        return [{"events": found, "next": 7}]

    daemon = FakeConversation(answer)
    monkeypatch.setattr(events, "Conversation", daemon)
    return daemon


def test_an_event_is_a_row_with_time_severity_name_and_words(daemon, capsys):
    assert main(["events"]) == FINE
    assert capsys.readouterr().out == "2026-05-01 12:00:00  warning  line_lost          line hall is down: unplugged\n"
    (asked,) = daemon.questions
    assert asked["count"] == 50
    assert asked.get("since") is None


def test_what_was_counted_is_told_with_the_number(monkeypatch, capsys):
    monkeypatch.setattr(events, "Conversation", telling({"events": [COUNTED], "next": 7}))
    assert main(["events"]) == FINE
    row = capsys.readouterr().out
    assert row.startswith("2026-05-01 12:30:05")
    assert row.endswith("(57 times since 2026-05-01 12:00:00)\n")


def test_the_options_select(daemon):
    words = ["events", "--since", "1h", "--line", "hall", "--unit", "41", "--client", "10.2.0.7", "--worst"]
    assert main(words) == FINE
    (asked,) = daemon.questions
    expected = {"since": 3600.0, "line": "hall", "unit": 41, "client": "10.2.0.7", "level": "warning"}
    assert {name: asked[name] for name in expected} == expected
    assert asked.get("count") is None


def test_json_is_an_object_a_line(daemon, capsys):
    assert main(["events", "--json"]) == FINE
    assert json.loads(capsys.readouterr().out) == LOST


def test_that_there_is_none_is_said(monkeypatch, capsys):
    monkeypatch.setattr(events, "Conversation", telling({"events": [], "next": 7}))
    assert main(["events"]) == FINE
    assert capsys.readouterr() == ("", "no such event is kept\n")
    assert main(["events", "--json"]) == FINE
    assert capsys.readouterr() == ("", "")


def test_a_time_that_is_none_is_wrong_usage(capsys):
    with pytest.raises(SystemExit) as left:
        main(["events", "--since", "yesterday"])
    assert left.value.code == WRONG_USAGE
    assert "--since" in capsys.readouterr().err


def test_following_goes_on_after_the_last_ones_until_ctrl_c(monkeypatch, capsys):
    daemon = following(monkeypatch, [LOST], [], [OTHER], end=KeyboardInterrupt())
    assert main(["events", "-f", "--line", "hall"]) == INTERRUPTED
    assert [line.split()[3] for line in capsys.readouterr().out.splitlines()] == ["line_lost", "line_up"]
    asked = [(each.get("count"), each.get("after"), each["line"]) for each in daemon.questions]
    assert asked == [(10, None, "hall"), *[(None, 7, "hall")] * 3]


def test_a_gateway_that_stops_ends_it(monkeypatch, capsys):
    following(monkeypatch, [LOST], end=GatewayGoneError("gone"))
    assert main(["events", "-f"]) == FINE
    assert capsys.readouterr().err == "the gateway has stopped\n"


def test_a_gateway_that_refuses_is_told(monkeypatch, capsys):
    following(monkeypatch, [LOST], end=DaemonError("the gateway says: no"))
    assert main(["events", "-f"]) == PROBLEM_FOUND
    assert "the gateway says: no" in capsys.readouterr().err


def test_an_event_that_goes_on_is_printed_once_a_minute(monkeypatch, capsys):
    clock = iter(range(0, 10_000, 25))
    monkeypatch.setattr(events.time, "monotonic", lambda: float(next(clock)))
    following(monkeypatch, [LOST], *[[{**COUNTED, "times": times}] for times in range(2, 9)], end=KeyboardInterrupt())
    main(["events", "-f"])
    counted = [line.rpartition("(")[2].split()[0] for line in capsys.readouterr().out.splitlines()[1:]]
    assert counted == ["4", "7"]


def test_what_a_device_says_does_not_steer_the_terminal(monkeypatch, capsys):
    monkeypatch.setattr(events, "Conversation", telling({"events": [OTHER], "next": 7}))
    main(["events"])
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize(("level", "paint"), [("error", red), ("warning", yellow), ("info", str)])
def test_a_severity_has_its_colour(level, paint):
    row = events._row({**LOST, "level": level})
    assert f"  {paint(f'{level:7}')}  line_lost" in row
