"""Counts in fixed buckets."""

from itertools import pairwise

import pytest

from gateway.timing.histogram import SECONDS, SHARES, Histogram, merged


def filled(*values: float) -> Histogram:
    histogram = Histogram(SECONDS)
    for value in values:
        histogram.add(value)
    return histogram


@pytest.mark.parametrize("scale", [SECONDS, SHARES])
def test_a_value_counts_in_the_first_bucket_whose_bound_is_above_it(scale) -> None:
    for place, (lower, upper) in enumerate(pairwise((0.0, *scale.bounds))):
        for value in (lower + 0.0001, (lower + upper) / 2, upper - 0.0001):
            histogram = Histogram(scale)
            histogram.add(value)
            assert histogram.counts.index(1) == place, value
            assert histogram.total == value


def test_what_is_above_all_bounds_has_a_bucket_of_its_own_and_what_is_below_0_is_0() -> None:
    histogram = filled(10.0001, 1e9, -1.0, 0.0)
    assert (histogram.counts[0], histogram.counts[-1], sum(histogram.counts)) == (2, 2, 4)
    assert histogram.total == 10.0001 + 1e9


def test_quantiles() -> None:
    assert filled().quantile(0.5) is None
    many = filled(*([0.0125] * 98), 0.4, 60.0)
    assert many.quantile(0.5) == pytest.approx(0.010 + 0.005 * 50 / 98)
    assert many.quantile(0.99) == pytest.approx(0.5)
    assert many.quantile(1.0) == 10.0  # the last bound: more is not known


def test_the_last_bucket_of_an_even_spread_is_found() -> None:
    even = Histogram(SHARES)
    for step in range(100):
        even.add(step / 100 + 0.005)
    assert even.quantile(0.5) == pytest.approx(0.5)
    assert even.quantile(0.99) == pytest.approx(0.99)


def test_several_together() -> None:
    whole = merged(SECONDS, [filled(0.0005, 0.4), filled(0.4)])
    assert (whole.counts[0], sum(whole.counts)) == (1, 3)
    assert whole.total == pytest.approx(0.8005)
    assert merged(SECONDS, []).quantile(0.99) is None


def test_the_bounds_are_those_that_dashboards_ask_for() -> None:
    whole = [1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 10_000]
    assert SECONDS.bounds == tuple(each / 1000 for each in whole)
    assert SHARES.bounds == tuple(each / 20 for each in range(1, 21))
