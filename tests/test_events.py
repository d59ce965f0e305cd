import dataclasses
import logging
from pathlib import Path

import pytest

from gateway import events

ALL = [event for event in vars(events).values() if isinstance(event, type) and issubclass(event, events.Event)]
ALL.remove(events.Event)


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
    assert event.__dataclass_params__.frozen
    assert event.__doc__
    assert not event.__doc__.startswith(f"{event.__name__}(")  # dataclass writes that one where none is given
    assert event.level in events.Level


def test_fields_are_what_the_event_tells():
    lost = events.LineLost(line="hall-a", port="/dev/ttyUSB0", reason="unplugged")
    assert lost.fields() == {"line": "hall-a", "port": "/dev/ttyUSB0", "reason": "unplugged"}
    assert events.Stopped().fields() == {}


def test_level_and_name_are_no_fields():
    for event in ALL:
        assert not {"level", "name"} & {field.name for field in dataclasses.fields(event)}


def test_what_needs_an_operator_is_a_warning_or_worse():
    assert events.LineLost.level == events.RequestTimeout.level == events.Level.WARNING
    assert events.PartFailed.level == events.Level.ERROR
    assert events.LineUp.level == events.Level.INFO


@pytest.mark.parametrize("event", ALL, ids=lambda event: event.name)
def test_the_operator_can_look_it_up(event):
    page = (Path(__file__).parents[1] / "docs" / "operations.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert any(f"`{event.name}`" in row for row in rows)


def test_a_part_that_failed_says_with_which_error_and_where() -> None:
    with pytest.raises(ZeroDivisionError) as raised:
        1 / 0  # noqa: B018 - nobody foresaw this
    told = events.PartFailed.of("line hall-a", raised.value)
    assert (told.part, told.error) == ("line hall-a", "ZeroDivisionError('division by zero')")
    assert "test_events.py" in told.traceback
