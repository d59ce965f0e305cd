"""The pictures of the last day: what a column tells, where there is none, and what stands beside them in words."""

from datetime import datetime
from types import SimpleNamespace

import pytest

from gateway.timing.history import STEP, UNIT_SLOTS, History, LineUse, UnitUse
from gateway.web.pages.busy import busy_outline, hours
from gateway.web.pages.heat_map import HEIGHT, KINDS, HeatMap, axis, clock, kind_of

NOON = 1_777_636_800.0
FINE = UnitUse(requests=60, responses=60, answer=0.6, share=6.0)
LINE = LineUse(600.0, 150.0, 0.0, 60, 3)
SILO = SimpleNamespace(name="silo", line="hall")


def history(*uses: UnitUse | None, line: LineUse = LINE) -> History:
    """Slots up to noon, with what the silo did; None is time without the gateway."""
    history = History()
    for number, use in enumerate(uses):
        if use is not None:
            history.add(NOON - (len(uses) - 1 - number) * STEP, {"hall": line}, {"silo": use} if use else {})
    return history


def row(*uses: UnitUse | None):
    return HeatMap().rows([SILO], history(*uses).last(NOON, len(uses)), 0.0)["silo"]


@pytest.mark.parametrize(
    ("use", "kind"),
    [
        (None, "idle"),
        (UnitUse(resting=600.0), "idle"),
        (FINE, "fine"),
        (FINE._replace(share=35.9), "fine"),
        (FINE._replace(share=36.0), "slow"),
        (FINE._replace(exceptions=2), "fine"),
        (FINE._replace(exceptions=3), "exceptions"),
        (FINE._replace(exceptions=3, share=36.0), "exceptions"),
        (FINE._replace(timeouts=1), "few"),
        (FINE._replace(timeouts=1, exceptions=30), "few"),
        (FINE._replace(timeouts=1, unsent=1), "few"),
        (FINE._replace(timeouts=1, failed=1, unsent=1), "many"),
        (FINE._replace(timeouts=59), "many"),
        (UnitUse(requests=60, unsent=60), "none"),
    ],
)
def test_what_a_column_tells(use, kind):
    assert kind_of(use) == kind


def test_equal_columns_are_one_outline_and_a_gap_is_none():
    lost = UnitUse(requests=60, timeouts=60)
    made = row(FINE, FINE, None, FINE, lost, UnitUse(), FINE)
    assert dict(made.columns) == {
        "fine": "M0 12v-4h2v4zM3 12v-4h1v4zM6 12v-4h1v4z",
        "none": "M4 12v-12h1v12z",
        "idle": "M5 12v-1h1v1z",
    }


def test_a_unit_of_a_line_that_was_not_there_yet_has_a_gap():
    yard = SimpleNamespace(name="crane", line="yard")
    assert HeatMap().rows([yard], history(FINE).last(NOON, 1), 0.0)["crane"].columns == ()


def test_each_kind_has_its_height_so_that_none_is_told_by_colour_only():
    patterns = {"slow", "exceptions", "none"}
    assert max(KINDS.values()) == HEIGHT
    assert len({(height, kind if kind in patterns else "") for kind, height in KINDS.items()}) == len(KINDS)


def test_sums_and_the_worst_slot_stand_beside_the_picture():
    made = row(FINE, FINE._replace(timeouts=7, unsent=2), FINE._replace(timeouts=3))
    assert (made.use.requests, made.use.unanswered, made.limit_share) == (180, 12, 0.1)
    assert made.use.unanswered_share == pytest.approx(12 / 180)
    assert (made.worst.begin, made.worst.end) == (clock(int(NOON // STEP) - 1), clock(int(NOON // STEP)))
    assert (made.worst.unanswered, made.worst.requests) == (9, 60)
    assert row(FINE).worst is None
    assert row(UnitUse()).limit_share is None


def test_rows_are_made_again_after_some_seconds_or_for_other_units():
    heat, before, after = HeatMap(), history(FINE), history(FINE._replace(timeouts=1))
    rows = heat.rows([SILO], before.last(NOON, 1), 100.0)
    assert heat.rows([SILO], after.last(NOON, 1), 109.0) is rows
    assert dict(heat.rows([SILO], after.last(NOON, 1), 110.0)["silo"].columns).keys() == {"few"}
    crane = SimpleNamespace(name="crane", line="hall")
    assert heat.rows([SILO, crane], after.last(NOON, 1), 111.0).keys() == {"silo", "crane"}


def test_the_times_along_a_picture_are_those_of_this_machine():
    past = history(FINE).last(NOON, UNIT_SLOTS)
    first = datetime.fromtimestamp(past.first * STEP).astimezone()
    whole_day = past._replace(slots=[past.slots[-1], *past.slots[1:]])
    assert axis(whole_day).ticks[0] == f"{first:%H:%M}"
    assert len(axis(whole_day).ticks) == 6


@pytest.mark.parametrize(
    ("known", "hours"), [(0, 1), (1, 1), (6, 1), (7, 3), (19, 6), (37, 12), (72, 12), (73, 24), (144, 24)]
)
def test_the_axis_of_a_new_gateway_begins_with_what_it_knows(known, hours):
    shown = axis(history(*[FINE] * known).last(NOON, UNIT_SLOTS))
    assert (shown.hours, shown.first, len(shown.ticks)) == (hours, UNIT_SLOTS - 6 * hours, 6)


def test_the_outline_of_a_busy_share():
    past = history(FINE, FINE, None, FINE).last(NOON, 4)
    assert busy_outline(past, "hall") == "M0 100V75h1V75h1V100zM3 100V75h1V100z"
    assert busy_outline(past, "yard") == ""


def test_hours_in_words_the_last_one_first():
    per_hour = 3600 // STEP
    past = history(*[FINE] * per_hour, *[None] * per_hour, FINE).last(NOON, 2 * per_hour + 1)
    rows = hours(past, "hall")
    assert [(each.busy_share, each.sent, each.failed) for each in rows] == [(0.25, 60, 3), (0.25, 360, 18)]
    assert rows[0].begin == clock(int(NOON // STEP))


def test_an_hour_of_the_day_before_is_not_taken_for_that_of_today():
    rows = hours(history(*[FINE] * UNIT_SLOTS).last(NOON, UNIT_SLOTS), "hall")
    begins = [each.begin for each in rows]
    assert len(set(begins)) == len(rows) >= 24
    assert {len(begin) for begin in begins} == {5, 11}
