import logging
import re
from pathlib import Path

import pytest

from gateway import events

ALL = [event for event in vars(events).values() if isinstance(event, type) and issubclass(event, events.Event)]
OF_PARTS = {"Emit", "discard_event"}
ALL.remove(events.Event)
ALL.remove(events.ClientEvent)


def test_all_of_them_can_be_imported_and_nothing_that_they_use():
    assert {*events.__all__} - OF_PARTS == {
        event.__name__ for event in (*ALL, events.Event, events.ClientEvent, events.Level)
    }


def test_levels_are_those_of_logging():
    assert {level.name: level.value for level in events.Level} == {
        level.name: getattr(logging, level.name) for level in events.Level
    }


@pytest.mark.parametrize(
    ("event", "name"),
    [(events.LineLost, "line_lost"), (events.BadFrame, "bad_frame"), (events.Ready, "ready")],
)
def test_the_name_in_logs_is_the_own_name_in_snake_case(event, name):
    assert event.name == name


def test_names_are_unique():
    assert len({event.name for event in ALL}) == len(ALL)


@pytest.mark.parametrize("event", ALL, ids=lambda event: event.name)
def test_each_event_is_frozen_explained_and_has_a_level(event):
    told = event(*range(len(event.field_names)))
    with pytest.raises(AttributeError, match="frozen"):
        told.client = "another"
    assert event.__doc__
    assert event.level in events.Level


def test_fields_are_what_the_event_tells():
    lost = events.LineLost(line="hall-a", port="/dev/ttyUSB0", reason="unplugged")
    assert lost.fields() == {"line": "hall-a", "port": "/dev/ttyUSB0", "reason": "unplugged"}
    assert events.Stopped().fields() == {}


@pytest.mark.parametrize("event", ALL, ids=lambda event: event.name)
def test_each_event_says_in_words_what_it_tells_but_no_bytes_of_a_line(event):
    told = event(*(f"<{name}>" for name in event.field_names))
    for template in (event.says, event.begins, *event.ends):
        assert set(re.findall(r"{(\w+)}", template)) <= {*event.field_names} - {"heard", "frame", "traceback"}
        assert not set("{}[]") & set(told.in_words(template))
    assert told.in_words()


def test_words_leave_out_what_is_empty_and_keep_zero():
    audit = events.WriteAudit("scada", "all", 41, 16, 0, 2, "ok", "", 4.0)
    assert audit.in_words() == "scada wrote to unit 41, address 0, count 2 with function 16: ok"
    diagnosis = events.WriteAudit("scada", "all", 41, 8, None, None, "exception", "01", 4.0, device="press")
    assert diagnosis.in_words() == "scada wrote to press, unit 41 with function 8: exception 01"
    assert events.LineUp("hall", "/dev/hall").in_words() == "line hall is up: /dev/hall is open"
    refused = events.RequestRefused("embedded", 60, 3, "02", "")
    assert refused.in_words() == "embedded asked unit 60 with function 3, and got 02"


def test_words_have_values_as_they_are():
    lost = events.LineLost("{port} [x]", "/dev/hall", "{line} [y]")
    assert lost.in_words() == "line {port} [x] is down: {line} [y]"
    applied = events.ConfigApplied("gateway.toml", ("line hall", "line yard"), (), (), ())
    assert applied.in_words() == "gateway.toml was applied; added: line hall, line yard"


def test_an_event_equals_another_one_that_tells_the_same():
    lost = events.LineLost("hall-a", "/dev/ttyUSB0", reason="unplugged")
    same = events.LineLost(line="hall-a", reason="unplugged", port="/dev/ttyUSB0")
    assert (lost, hash(lost)) == (same, hash(same))
    assert lost not in {
        events.LineLost("hall-a", "/dev/ttyUSB0", "lost"),
        events.QueueFull("hall-a", 1, "", ""),
        "lost",
    }
    assert events.LineUp("hall-a", "/dev/ttyUSB0") == events.LineUp("hall-a", "/dev/ttyUSB0", None)
    assert events.WebUp("http://x") != events.ListenerUp("http://x", "http://x")
    assert events.WebUp("http://x") != events.StateKeptAgain("http://x")
    assert repr(lost) == "LineLost(line='hall-a', port='/dev/ttyUSB0', reason='unplugged')"


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ((), {}),
        (("a", "b"), {}),
        (("a", "b", "c", "d"), {}),
        (("a", "b", "c"), {"line": "a"}),
        (("a", "b"), {"line": "a"}),
        (("a", "b"), {"reasons": "c"}),
        (("a", "b", "c"), {"level": events.Level.DEBUG}),
    ],
)
def test_an_event_has_all_of_its_fields_and_no_others(values, named):
    with pytest.raises(TypeError, match="LineLost"):
        events.LineLost(*values, **named)


def test_level_and_name_are_no_fields():
    for event in ALL:
        assert not {"level", "name"} & set(event.field_names)


def test_what_needs_an_operator_is_a_warning_or_worse():
    assert events.LineLost.level == events.RequestTimeout.level == events.Level.WARNING
    assert events.PartFailed.level == events.Level.ERROR
    assert events.LineUp.level == events.Level.INFO


@pytest.mark.parametrize("event", ALL, ids=lambda event: event.name)
def test_the_operator_can_look_it_up(event):
    page = (Path(__file__).parents[1] / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert any(f"`{event.name}`" in row for row in rows)


def test_a_part_that_failed_says_with_which_error_and_where() -> None:
    with pytest.raises(ZeroDivisionError) as raised:
        1 / 0  # noqa: B018 - nobody foresaw this
    told = events.PartFailed.of("line hall-a", raised.value)
    assert (told.part, told.error) == ("line hall-a", "ZeroDivisionError('division by zero')")
    assert "test_events.py" in told.traceback
