from math import inf, nan

import pytest

from gateway.modbus.codes import Area
from gateway.plant.changes import LOST_AFTER, Watch
from gateway.plant.messages import Reading
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint


def watch(**options):
    point = PublishedPoint(Point("a", Area.HOLDING, 0), 1.0, **options)
    return Watch(PublishedDevice("d", 1, "profile", (point,)), patience=0.5)


@pytest.mark.parametrize(
    ("old", "new", "deadband", "is_change"),
    [
        (1, 1, None, False),
        (1, 2, None, True),
        (1.0, 1, None, False),
        ("off", "on", None, True),
        ("off", "off", 5.0, False),
        ("off", 3, 5.0, True),
        (1.0, 1.4, 0.5, False),
        (1.0, 1.5, 0.5, True),
        (1.0, 0.5, 0.5, True),
        (1, 1, 0.0, False),
        (1, 2, 0.0, True),
        (nan, nan, None, False),
        (nan, nan, 0.5, False),
        (nan, 1.0, None, True),
        (1.0, nan, 0.5, True),
        (nan, 1.0, 0.5, True),
        (inf, inf, 0.5, False),
        (inf, -inf, 0.5, True),
        (1.0, inf, 0.5, True),
        (None, None, None, False),
        (None, None, 0.5, False),
        (None, 1.0, 0.5, True),
        (1.0, None, 0.5, True),
        (None, 0, None, True),
        ("off", None, None, True),
    ],
)
def test_what_is_a_change(old, new, deadband, is_change):
    seen = watch(on_change=deadband)
    seen.published({"a": Reading(old, 0.0)})
    seen.answered({"a": new}, 1.0, 1.0)
    assert (set(seen.changed) == {"a"}) is is_change


def test_small_steps_add_up():
    seen = watch(on_change=1.0)
    seen.published({"a": Reading(0.0, 0.0)})
    for step in range(1, 10):
        seen.answered({"a": step / 10}, float(step), float(step))
        assert not seen.changed
    seen.answered({"a": 1.0}, 10.0, 10.0)
    assert set(seen.changed) == {"a"}


def test_the_same_value_is_due_before_the_next_reading_would_be_too_late():
    seen = watch(at_least=3.0)
    seen.published({"a": Reading(1, 0.0)})
    due = []
    for now in range(1, 4):
        seen.answered({"a": 1}, float(now), float(now))
        due.append(bool(seen.changed))
    assert due == [False, False, True]


def test_a_reading_is_new_for_its_interval_and_the_time_of_a_read():
    seen = watch()
    seen.answered({"a": 1}, 10.0, 10.0)
    assert seen.readings(11.5) == {"a": Reading(1, 10.0, 10.0)}
    assert seen.readings(11.6) == {}


def test_a_device_is_gone_after_several_failures_in_a_row_and_back_with_one_answer():
    seen = watch()
    assert seen.state(0.0).is_available is False
    for now in (0.0, 1.0):
        seen.answered({"a": 1}, now, now)
    there = []
    for _ in range(LOST_AFTER):
        seen.failed()
        there.append(seen.is_available)
    assert there == [*[True] * (LOST_AFTER - 1), False]
    assert (seen.state(1.0).is_available, seen.readings(1.0)) == (False, {})
    seen.answered({"a": 1}, 2.0, 2.0)
    assert seen.is_available
    assert set(seen.changed) == {"a"}, "what was published before it was gone counts no more"


def test_a_published_reading_that_is_too_old_is_taken_back_once():
    seen = watch()
    seen.answered({"a": 1}, 0.0, 0.0)
    seen.published(seen.readings(0.0))
    seen.expire(1.5)
    assert set(seen.changed) == set()
    seen.expire(1.6)
    assert (seen.changed, seen.readings(1.6)) == ({"a": None}, {})
    seen.published({})
    seen.expire(2.6)
    assert set(seen.changed) == set()
    seen.answered({"a": 1}, 3.0, 3.0)
    assert set(seen.changed) == {"a"}, "the same value is new after that"


def test_a_reading_that_was_never_published_is_not_taken_back():
    seen = watch()
    seen.answered({"a": 1}, 0.0, 0.0)
    seen.changed.clear()
    seen.expire(9.0)
    assert set(seen.changed) == set()


def test_a_reading_that_waits_is_returned_when_another_takes_its_place_or_the_device_is_gone():
    seen = watch(on_change=1.0)
    seen.answered({"a": 1.0}, 0.0, 0.0)
    assert seen.answered({"a": 1.4}, 1.0, 1.0) == {}
    assert seen.answered({"a": 2.0}, 2.0, 2.0) == {"a": Reading(1.0, 0.0, 0.0)}
    assert [seen.failed() for _ in range(LOST_AFTER)][-1] == {"a": Reading(2.0, 2.0, 2.0)}
    seen.answered({"a": 3.0}, 3.0, 3.0)
    assert seen.expire(9.0) == {"a": Reading(3.0, 3.0, 3.0)}
