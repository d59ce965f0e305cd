"""Plausible values: what a device of its kind may well show, by unit and name of a point, and how it changes."""

from dataclasses import dataclass, replace
from math import sin, tau
from random import Random
from typing import Final, NamedTuple


@dataclass(frozen=True, slots=True)
class Course:
    """A value over time: it swings around `middle`, or grows by `growth` a second. All of it is within a range."""

    middle: float
    swing: float = 0.0
    period: float = 300.0
    phase: float = 0.0
    growth: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it changes."""
        return self.swing != 0 or self.growth != 0

    def at(self, seconds: float) -> float:
        """Compute the value after so many seconds."""
        return self.middle + self.swing * sin(tau * (seconds / self.period) + self.phase) + self.growth * seconds


class _Usual(NamedTuple):
    """A usual value, by how much of it it swings, and its growth a second."""

    value: float
    swing: float = 0.0
    growth: float = 0.0


_POWER: Final = 1840.0
_HOUR: Final = 3600.0

#: By a word in the name of the point; those of a unit as well come first.
_BY_NAME: Final[tuple[tuple[str, str, _Usual], ...]] = (
    ("-l1-l2", "V", _Usual(400, 0.01)),
    ("-l2-l3", "V", _Usual(400, 0.01)),
    ("-l3-l1", "V", _Usual(400, 0.01)),
    ("line-to-line", "V", _Usual(400, 0.01)),
    ("battery", "V", _Usual(51.2, 0.01)),
    ("pv", "V", _Usual(620, 0.02)),
    ("dc", "V", _Usual(620, 0.02)),
    ("neutral", "A", _Usual(0.4, 0.1)),
    ("power-factor", "", _Usual(0.97, 0.01)),
    ("cos-phi", "", _Usual(0.97, 0.01)),
    ("export", "Wh", _Usual(1_234_500.0, growth=_POWER / 2 / _HOUR)),
    ("humidity", "%", _Usual(45, 0.03)),
    ("thd", "%", _Usual(2.4, 0.1)),
)

#: By unit, without a prefix.
_BY_UNIT: Final = {
    "V": _Usual(230, 0.01),
    "A": _Usual(8, 0.05),
    "W": _Usual(_POWER, 0.05),
    "var": _Usual(310, 0.05),
    "VA": _Usual(1870, 0.05),
    "Hz": _Usual(50, 0.001),
    "Wh": _Usual(12_345_600.0, growth=_POWER / _HOUR),
    "varh": _Usual(2_345_600.0, growth=310 / _HOUR),
    "VAh": _Usual(13_345_600.0, growth=1870 / _HOUR),
    "Ah": _Usual(1200, growth=8 / _HOUR),
    "J": _Usual(4.4e10, growth=_POWER),
    "°C": _Usual(21, 0.02),
    "°F": _Usual(70, 0.02),
    "K": _Usual(294, 0.002),
    "%": _Usual(50, 0.05),
    "rpm": _Usual(1450, 0.01),
    "1/min": _Usual(1450, 0.01),
    "bar": _Usual(2.5, 0.02),
    "Pa": _Usual(101_300, 0.001),
    "m³": _Usual(1234.5, growth=1.2 / _HOUR),
    "m³/h": _Usual(1.2, 0.05),
    "l": _Usual(1_234_500, growth=1200 / _HOUR),
    "l/h": _Usual(1200, 0.05),
    "l/min": _Usual(20, 0.05),
    "kg": _Usual(1250, 0.01),
    "t": _Usual(1.25, 0.01),
    "N": _Usual(900, 0.02),
    "Nm": _Usual(12, 0.03),
    "m/s": _Usual(4.2, 0.1),
    "W/m²": _Usual(640, 0.05),
    "lx": _Usual(500, 0.03),
    "lux": _Usual(500, 0.03),
    "ppm": _Usual(620, 0.03),
    "Ω": _Usual(110, 0.001),
    "s": _Usual(3600),
    "min": _Usual(60),
    "h": _Usual(4321, growth=1 / _HOUR),
    "d": _Usual(180),
    "°": _Usual(180, 0.02),
}
#: Prefixes that units are written with.
_PREFIXES: Final = {"M": 1e6, "k": 1e3, "h": 1e2, "c": 1e-2, "m": 1e-3, "µ": 1e-6}
#: Other numbers are small whole ones.
_OTHERS: Final = _Usual(0)
_MOST: Final = 20
#: Swings take between so many seconds and twice as many.
_PERIOD: Final = 300.0
#: Where a value lies between the bounds, if the usual one is outside.
_INSIDE: Final = 0.6


def course_of(name: str, unit: str, least: float, greatest: float, dice: Random, *, steady: bool = False) -> Course:
    """Choose the course of a value in `unit` that stays between `least` and `greatest`.

    Different points of a device get slightly different values, by `dice`. A `steady` one does not change.
    """
    usual, prefix = _usual(name, unit)
    middle = usual.value / prefix * (1 + 0.004 * dice.random()) if usual != _OTHERS else dice.randint(1, _MOST)
    if not least <= middle <= greatest:
        middle = _between(least, greatest)
    swing = min(abs(middle) * usual.swing, greatest - middle, middle - least)
    course = Course(middle, swing, _PERIOD * (1 + dice.random()), tau * dice.random(), usual.growth / prefix)
    return replace(course, swing=0.0, growth=0.0) if steady else course


def _usual(name: str, unit: str) -> tuple[_Usual, float]:
    """Find the usual value of such a point, and what its unit's prefix stands for."""
    plain, prefix = (unit, 1.0) if unit in _BY_UNIT or unit[1:] not in _BY_UNIT else (unit[1:], _PREFIXES.get(unit[0]))
    if prefix is None:
        return _OTHERS, 1.0
    for word, of_unit, usual in _BY_NAME:
        if word in name and of_unit == plain:
            return usual, prefix
    return _BY_UNIT.get(plain, _OTHERS), prefix


def _between(least: float, greatest: float) -> float:
    return least + _INSIDE * (greatest - least)
