import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.timing.table import Point, TimingTable

#: FC03 and FC05 of the Mint motion controller.
MINT = TimingTable.of({3: [Point(1, 0.010), Point(99, 0.420)], 5: [Point(1, 0.010)]})


@pytest.mark.parametrize(
    ("items", "time"),
    [
        pytest.param(1, 0.010, id="first point"),
        pytest.param(99, 0.420, id="last point"),
        pytest.param(50, 0.215, id="half way"),
        pytest.param(0, 0.010, id="flat before the first"),
        pytest.param(197, 0.830, id="the last slope goes on"),
    ],
)
def test_points_are_joined_by_straight_lines(items, time):
    assert MINT.time(3, items) == pytest.approx(time)


@pytest.mark.parametrize("items", [0, 1, 2, 100])
def test_a_single_point_holds_for_any_number_of_items(items):
    assert MINT.time(5, items) == 0.010


def test_a_table_with_a_knee_follows_each_of_its_slopes():
    table = TimingTable.of({3: [Point(10, 0.1), Point(20, 0.1), Point(30, 0.4)]})
    assert table.time(3, 15) == pytest.approx(0.1)
    assert table.time(3, 25) == pytest.approx(0.25)
    assert table.time(3, 40) == pytest.approx(0.7)


def test_a_function_without_a_row_has_no_time():
    assert MINT.time(16, 1) is None
    assert TimingTable().time(3, 1) is None


def test_points_may_come_in_any_order():
    assert TimingTable.of({3: [Point(99, 0.420), Point(1, 0.010)]}) == TimingTable.of(
        {3: [Point(1, 0.010), Point(99, 0.420)]}
    )


def test_two_times_for_the_same_items_are_refused():
    with pytest.raises(ValueError, match="function 3 has two times for 7 items"):
        TimingTable.of({3: [Point(7, 0.1), Point(7, 0.2)]})


def test_a_time_that_decreases_is_refused():
    with pytest.raises(ValueError, match="function 3: more items cannot take less time"):
        TimingTable.of({3: [Point(1, 0.2), Point(7, 0.1)]})


def test_the_slowest_is_the_longest_time_named():
    assert MINT.slowest == 0.420
    assert TimingTable().slowest == 0.0


ROWS = st.dictionaries(st.integers(1, 125), st.floats(0, 10), min_size=1, max_size=5).map(
    lambda row: [Point(items, time) for items, time in zip(sorted(row), sorted(row.values()), strict=True)]
)


@given(ROWS, st.integers(0, 2000), st.integers(0, 2000))
def test_more_items_never_take_less_time(row, one, other):
    table = TimingTable.of({3: row})
    fewer, more = sorted((one, other))
    assert table.time(3, fewer) <= table.time(3, more) + 1e-9


@given(ROWS)
def test_the_table_goes_through_its_points(row):
    table = TimingTable.of({3: row})
    for point in row:
        assert table.time(3, point.items) == pytest.approx(point.time)
