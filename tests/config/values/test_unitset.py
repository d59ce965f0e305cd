"""Unit sets: a number, a range, or a list of both."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.problem import WrongValue
from gateway.config.values.unitset import parse_units, show_units


@pytest.mark.parametrize(
    ("value", "units"),
    [
        (7, (7,)),
        ("7", (7,)),
        ("10-13", (10, 11, 12, 13)),
        ("10 - 11", (10, 11)),
        (["10-11", 3], (10, 11, 3)),
        ("1-1", (1,)),
        (247, (247,)),
        (["246-248", 255], (246, 247, 248, 255)),
    ],
)
def test_units_come_in_the_order_in_which_they_are_written(value, units):
    assert parse_units(value) == units


@pytest.mark.parametrize(
    ("value", "what"),
    [
        (0, "unit 0 is outside 1-255"),
        (256, "unit 256 is outside 1-255"),
        ("240-300", "unit 300 is outside 1-255"),
        ("1-99999999999", "unit 99999999999 is outside 1-255"),
        ("13-10", '"13-10" counts backwards'),
        ([1, "1-3"], "names unit 1 twice"),
        ([], "names no unit"),
        ("all", '"all" is not a valid unit'),
        (True, "true is not a valid unit"),
        (1.5, "1.5 is not a valid unit"),
        (-1, "unit -1 is outside 1-255"),
    ],
)
def test_what_is_no_unit_set_is_refused(value, what):
    with pytest.raises(WrongValue) as caught:
        parse_units(value)
    assert str(caught.value) == what


def test_who_is_outside_is_not_told_of_the_special_unit_0():
    with pytest.raises(WrongValue, match="unit 256 is outside 1-255"):
        parse_units(256, first=0)


def test_unit_0_can_be_asked_for():
    assert parse_units(0, first=0) == (0,)


def test_neighbours_are_shown_as_a_range():
    assert show_units([7, 2, 1, 3]) == "1-3, 7"
    assert show_units([]) == ""


@given(st.lists(st.integers(1, 255), min_size=1, unique=True))
def test_what_is_shown_can_be_written(units):
    assert parse_units(show_units(units).split(", ")) == tuple(sorted(units))
