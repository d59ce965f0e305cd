"""Plausible values by unit and name."""

from math import inf
from random import Random

import pytest

from gateway.simulator.plausible import course_of


def value(name, unit, least=-inf, greatest=inf, at=0.0):
    return course_of(name, unit, least, greatest, Random(1)).at(at)


@pytest.mark.parametrize(
    ("name", "unit", "about"),
    [
        ("voltage-l1", "V", 230),
        ("voltage-l1-l2", "V", 400),
        ("battery-voltage", "V", 51.2),
        ("active-power", "W", 1840),
        ("active-power", "kW", 1.84),
        ("frequency", "Hz", 50),
        ("frequency", "mHz", 50_000),
        ("temperature", "°C", 21),
        ("power-factor", "", 0.97),
        ("energy-import", "kWh", 12_345),
        ("energy-import", "MWh", 12.3),
        ("energy-import", "varh", 2_345_600),
        ("pressure", "hPa", 1013),
        ("length", "mm", 10),
    ],
)
def test_the_usual_value_of_a_unit(name, unit, about):
    assert value(name, unit) == pytest.approx(about, rel=1.0 if unit == "mm" else 0.06)


def test_what_has_no_known_unit_is_a_small_whole_number():
    assert value("speed", "furlong", 0, 1000) in range(1, 21)
    assert value("speed", "xW", 0, 1000) in range(1, 21)


@pytest.mark.parametrize(("least", "greatest"), [(0, 100), (1000, 2000), (-5, -1), (230, 230)])
def test_it_stays_within_the_limits(least, greatest):
    for second in range(0, 1000, 10):
        assert least - 1e-9 <= value("voltage", "V", least, greatest, second) <= greatest + 1e-9


def test_a_steady_one_does_not_change():
    course = course_of("energy", "kWh", -inf, inf, Random(1), steady=True)
    assert not course.moves
    assert course.at(0) == course.at(5000)
