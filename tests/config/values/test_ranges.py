"""Ranges of addresses: a count, a range, or a list of ranges."""

import pytest

from gateway.config.problem import WrongValue
from gateway.config.values.ranges import parse_addresses, parse_ranges, show_ranges


@pytest.mark.parametrize(
    ("value", "ranges"),
    [
        (100, ((0, 99),)),
        (65536, ((0, 65535),)),
        (0, ()),
        ("1-99", ((1, 99),)),
        ("5", ((5, 5),)),
        (["20-29", "0-9"], ((0, 9), (20, 29))),
        (["0-9", "10-19"], ((0, 19),)),
        (["0-9", "3-5"], ((0, 9),)),
    ],
)
def test_ranges_are_ascending_and_those_that_touch_are_joined(value, ranges):
    assert parse_ranges(value) == ranges


@pytest.mark.parametrize(
    ("value", "what"),
    [
        (65537, "a count is 0 to 65536"),
        (-1, "a count is 0 to 65536"),
        ("9-1", '"9-1" counts backwards'),
        ("0-65536", "address 65536 is above 65535"),
        ("all", "is not a valid range of addresses"),
        (True, "is not a valid range of addresses"),
        ([5], "is not a valid range of addresses"),
        (1.5, "is not a valid range of addresses"),
    ],
)
def test_what_is_no_range_is_refused(value, what):
    with pytest.raises(WrongValue) as caught:
        parse_ranges(value)
    assert str(caught.value) == what


@pytest.mark.parametrize("value", [100, 0, [], [5], "9-1", "none"])
def test_what_is_no_range_of_a_row_is_refused_with_one_that_is(value):
    with pytest.raises(WrongValue) as caught:
        parse_addresses(value)
    remedy = caught.value.remedy
    assert "count" not in remedy
    assert parse_addresses(remedy.split('"')[1])


def test_ranges_are_shown_as_they_are_written():
    assert show_ranges(((0, 9), (20, 29))) == "0-9, 20-29"
    assert show_ranges(()) == "none"
