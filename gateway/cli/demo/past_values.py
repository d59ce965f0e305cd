"""Values of the day that `past` makes up. They are MADE UP, too, and lead to those that the devices really have."""

from collections.abc import Iterator
from math import sin
from random import Random
from typing import Final, NamedTuple

from gateway.cli.demo.past import STOPPED, UNPLUGGED, activity
from gateway.clock.slices import in_slices
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import KeptTrends, kept_trends
from gateway.operator.trends.told import trend_of
from gateway.operator.units.reached import device_of
from gateway.operator.values.known_values import devices_with_points, known_points
from gateway.profiles.point import Point
from gateway.timing.history import slot_at

#: Values are made up for each minute of a day, in seconds.
_STEP: Final = 60
_DAY: Final = 24 * 3600
#: What counts, and by how much in an hour of such work as there is now.
_COUNTS: Final = {"kWh": 1.84, "kvarh": 0.31, "kVAh": 1.87}
#: What is proportional to the load of the plant, of which so much is left at night.
_LOADS: Final = ("W", "VA", "var", "A")
_AT_NIGHT: Final = 0.25
#: How far others are moved by the full load, and by how much they tremble.
_MOVES: Final = {"°C": 2.4, "%": -6.0, "V": -1.5}
_TREMBLES: Final = {"°C": 0.1, "%": 0.4, "V": 0.8, "Hz": 0.02, "kg": 1.5}
#: How things tremble: the shares and the paces, in seconds, of waves that never meet again.
_WAVES: Final = ((0.5, 2311.0), (0.3, 613.0), (0.2, 131.0))
#: The band of a load around its mean.
_BAND: Final = 0.03
#: The point of the scales, which tell no unit of measure; one of them always shows the weight of the printed example.
_WEIGHT: Final = "weight"
_STEADY: Final = "silo-1"
_MOST: Final = "-max"


class Course(NamedTuple):
    """How a value in a unit of measure came to what it is now, when the plant has this load."""

    value: float
    measure: str
    load: float
    phase: float

    def band(self, ago: float, load: float, work: float) -> tuple[float, float, float]:
        """Make up the least, the mean and the greatest value of a minute so many seconds ago.

        The plant had this load then, and did so much work since: 1 is an hour with the load that it has now.
        """
        if self.measure in _COUNTS:
            mean = self.value - _COUNTS[self.measure] * work
            return mean, mean, mean
        wave = sum(share * sin(ago / pace + self.phase * pace) for share, pace in _WAVES)
        if self.measure in _LOADS:
            mean = self.value * load / self.load * (1 + _BAND * wave)
            return mean * (1 - _BAND), mean, mean * (1 + _BAND)
        tremble = _TREMBLES.get(self.measure, 0.0)
        mean = self.value + _MOVES.get(self.measure, 0.0) * (load - self.load) + tremble * wave
        return mean - tremble, mean, mean + tremble


class _Past(NamedTuple):
    """A trend and its course, of a device on a line."""

    line: str
    trend: int
    course: Course


async def make_up_values(operator: Operator, asker: Asker) -> None:
    """Add a day to the trends of all points with a unit of measure that move and are known, if trends are kept."""
    trends = kept_trends(operator)
    if trends is not None:
        await in_slices(_minutes(trends, list(_pasts(operator, asker)), operator.clock()))


def load_at(time: float) -> float:
    """Compute the load of the plant at a time, in seconds since 1970; 1 is the full one."""
    return _AT_NIGHT + (1 - _AT_NIGHT) * activity(time)


def _pasts(operator: Operator, asker: Asker) -> Iterator[_Past]:
    load, dice = load_at(operator.clock()), Random("demo")  # noqa: S311 - not a secret, and repeatable
    for unit in devices_with_points(operator):
        device = device_of(operator.gateway, unit.key)
        line = "" if device is None else device.line_name
        for known in known_points(operator, unit, asker):
            value = None if known.reading is None else known.reading.value
            trend, point = trend_of(operator, unit, known.point), known.point
            measure = "kg" if point.name == _WEIGHT else point.unit
            if trend is None or not isinstance(value, int | float) or not measure or _stands_still(point):
                continue
            measure = "" if unit.name == _STEADY else measure
            yield _Past(line, trend, Course(float(value), measure, load, 6 * dice.random()))


def _stands_still(point: Point) -> bool:
    """Tell whether a point is a setting, or the most since somebody has reset it."""
    return point.write != "no" or point.name.endswith(_MOST)


def _minutes(trends: KeptTrends, pasts: list[_Past], now: float) -> Iterator[None]:
    """Make up one minute after the other, back from now."""
    work, load_now = 0.0, load_at(now)
    for ago in range(_STEP, _DAY, _STEP):
        load = load_at(now - ago)
        work += load / load_now * _STEP / 3600
        slots = slot_at(now) - slot_at(now - ago)
        if not STOPPED.is_at(slots):
            there = [past for past in pasts if past.line != UNPLUGGED.unit or not UNPLUGGED.is_at(slots)]
            for past in there:
                trends.add_past(now - ago, past.trend, [round(each, 3) for each in past.course.band(ago, load, work)])
        yield
