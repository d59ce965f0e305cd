"""How a file has the values of a point, and that nothing of them is lost on the way."""

from array import array
from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.timing.trend import GREATEST, Layout, Slot, merge, pack, put, unpack

DAY = Layout.of(24 * 3600)
WEEK = Layout.of(7 * 24 * 3600)
NOON = 1_777_636_800


def piece_of(*slots: tuple[float, float, float] | None, layout: Layout = DAY) -> array:
    piece = layout.piece()
    for at, numbers in enumerate(slots):
        if numbers is not None:
            put(piece, layout.place(at * layout.step), numbers)
    return piece


def there(piece: array) -> list[tuple[float, ...] | None]:
    rows = [tuple(piece[at : at + 3]) for at in range(0, len(piece), 3)]
    return [None if isnan(row[0]) else row for row in rows]


def test_slots_of_a_day_and_of_a_week():
    assert (DAY.step, DAY.block, DAY.slots) == (60, 600, 10)
    assert (WEEK.step, WEEK.block, WEEK.slots) == (600, 3600, 6)
    assert Layout.of(24 * 3600 + 1).step == 600


def test_gaps_stay_gaps():
    piece = piece_of((1.0, 2.0, 3.0), None, (4.0, 5.0, 6.0))
    assert there(unpack(pack(piece), DAY))[:4] == [(1, 2, 3), None, (4, 5, 6), None]
    assert list(DAY.within(NOON, piece)) == [Slot(NOON, 1, 2, 3), Slot(NOON + 120, 4, 5, 6)]


@pytest.mark.parametrize("layout", [DAY, WEEK])
def test_a_counter_keeps_its_digits(layout):
    slots = [
        (round(12_345_678.9 + minute / 10, 1), 12_345_679.0 + minute, 12_345_999.9 + minute) for minute in range(6)
    ]
    assert there(unpack(pack(piece_of(*slots, layout=layout)), layout))[:6] == slots


def test_a_value_that_does_not_change_takes_ten_bytes():
    assert len(pack(piece_of(*[(4999.66, 4999.66, 4999.66)] * 10))) == 10
    assert len(pack(piece_of(*[(at, at + 0.1, at + 0.2) for at in range(10)]))) == 130


def test_the_greatest_values_can_be_told_apart():
    slots = [(-GREATEST, 0.0, GREATEST)]
    (row, *_) = there(unpack(pack(piece_of(*slots)), DAY))
    assert row == pytest.approx(slots[0], rel=1e-6, abs=GREATEST * 1e-6)


@given(st.lists(st.none() | st.tuples(*[st.integers(-(2**31), 2**32)] * 3), min_size=1, max_size=10))
def test_any_whole_numbers_keep_seven_digits_of_what_they_differ(slots):
    slots = [None if slot is None else tuple(sorted(map(float, slot))) for slot in slots]
    if not any(slots):
        return
    piece = piece_of(*slots)
    spread = max(slot[2] for slot in slots if slot) - min(slot[0] for slot in slots if slot)
    for before, after in zip(there(piece), there(unpack(pack(piece), DAY)), strict=True):
        assert (before is None) == (after is None)
        if before is not None:
            assert after == pytest.approx(before, rel=1e-15, abs=max(spread * 1e-6, 1e-9))
            assert after[0] <= after[1] <= after[2]


def test_the_mean_is_between_least_and_greatest_whatever_is_rounded():
    slots = [(2e-7,) * 3, (1.00000014, 1.00000026, 1.0000004)]
    least, mean, greatest = there(unpack(pack(piece_of(*slots)), DAY))[1]
    assert least <= mean <= greatest
    assert (least, greatest) == pytest.approx((1.0, 1.0), abs=1e-6)


def test_what_is_heard_later_is_added():
    piece = piece_of((1.0, 2.0, 3.0), None, (7.0, 7.0, 7.0))
    merge(piece, piece_of((2.0, 4.0, 8.0), (5.0, 5.0, 5.0)))
    assert there(piece)[:4] == [(1, 4, 8), (5, 5, 5), (7, 7, 7), None]


@pytest.mark.parametrize("content", [b"", b"\x01\x00", bytes(200), pack(piece_of(*[(1.0, 2.0, 3.0)] * 10))])
def test_what_another_layout_or_nobody_has_written_is_refused(content):
    with pytest.raises(ValueError, match=r"bytes|size"):
        unpack(content, WEEK)


def test_room_for_so_many_points():
    assert 1000 < DAY.points < 1200
    assert 1200 < WEEK.points < 1500
    assert 18 < Layout.of(3600).points / DAY.points < 24
