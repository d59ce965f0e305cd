"""The values that the demo makes up: they lead to those that devices have, and move as such values do."""

from itertools import pairwise

import pytest

from gateway.cli.demo import past_values
from gateway.cli.demo.past import STOPPED, UNPLUGGED
from gateway.cli.demo.past_values import Course, _minutes, _Past, load_at
from gateway.operator.trends.kept import KeptTrends
from gateway.operator.trends.trends import Trends
from gateway.timing.history import STEP
from gateway.timing.trend import Layout


def course(value, measure, load=0.6):
    return Course(value, measure, load, 1.0)


@pytest.mark.parametrize("measure", ["W", "A", "kWh", "V", "°C", "kg", "°", ""])
def test_the_last_minute_is_near_the_value_of_now(measure):
    least, mean, greatest = course(230.0, measure).band(60.0, 0.6, 1 / 60)
    assert least <= mean <= greatest
    assert mean == pytest.approx(230.0, rel=0.04)


def test_counters_only_grow():
    counted = [course(12_345.0, "kWh").band(ago, 0.6, ago / 3600)[1] for ago in range(86_400, 0, -60)]
    assert all(before < after for before, after in pairwise(counted))
    assert 12_345 - counted[0] == pytest.approx(24 * 1.84)


def test_a_load_rises_with_what_goes_on():
    assert course(1000.0, "W").band(3600.0, 0.3, 1.0)[1] == pytest.approx(500, rel=0.05)


def test_a_weight_that_always_stands_there_stands_there():
    """That of silo-1, whose unit of measure is left out for it."""
    assert course(4999.66, "").band(7200.0, 0.9, 2.0) == (4999.66,) * 3


async def test_a_day_is_added_with_its_gaps(now):
    trends = KeptTrends(Trends(Layout.of(24 * 3600)))
    yard, hall = (_Past(line, trend, course(5.0, "kg")) for trend, line in enumerate((UNPLUGGED.unit, "hall")))
    for _ in _minutes(trends, [yard, hall], now):
        pass
    slots = {past.line: await trends.slots(past.trend, now - 86_400, now) for past in (yard, hall)}
    gap = STOPPED.slots * STEP / 60
    assert len(slots["hall"]) == pytest.approx(24 * 60 - gap, abs=2)
    assert len(slots["hall"]) - len(slots["yard"]) == UNPLUGGED.slots * STEP / 60
    assert max(slot.time for slot in slots["hall"]) < now - 4


def test_the_load_is_never_nothing(now):
    loads = [load_at(now + minute * 60) for minute in range(24 * 60)]
    assert past_values._AT_NIGHT <= min(loads) < 0.3
    assert 0.9 < max(loads) <= 1
