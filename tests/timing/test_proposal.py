"""The line through measured times."""

import pytest

from gateway.timing.measured import KEPT, MOST_SIZES, Samples
from gateway.timing.proposal import fit


def table(items: int) -> float:
    """The Mint controller's function 03."""
    return 0.010 + (items - 1) * 0.410 / 98


SIZES = (1, 10, 25, 50, 75, 99)


def test_exact_times_are_their_line() -> None:
    line = fit({items: [table(items)] * 3 for items in SIZES})
    assert [line.time(items) for items in (1, 40, 99)] == pytest.approx([table(items) for items in (1, 40, 99)])


def test_outliers_do_not_bend_it() -> None:
    times = {items: [table(items)] * 6 + [2.0] * 5 for items in SIZES}
    times[50] = [1.0] * 11
    assert fit(times).time(99) == pytest.approx(table(99), rel=0.05)


def test_one_size_is_flat_and_less_time_for_more_items_too() -> None:
    assert fit({10: [0.02, 0.03, 0.04]}).time(99) == 0.03
    falling = fit({1: [0.03], 10: [0.02]})
    assert falling.time(1) == falling.time(10) == 0.025


def test_no_time_is_negative() -> None:
    assert fit({10: [0.001], 20: [0.1]}).time(1) == 0.0


def test_without_times_there_is_none() -> None:
    with pytest.raises(ValueError, match="no response times"):
        fit({3: []})


def test_the_samples_are_bounded() -> None:
    samples = Samples()
    for items in range(2 * MOST_SIZES):
        for number in range(2 * KEPT):
            samples.add(items, float(number))
    assert len(samples.rows) == MOST_SIZES
    assert samples.rows[0].count == 2 * KEPT
    assert list(samples.rows[0].times) == [float(number) for number in range(KEPT, 2 * KEPT)]
