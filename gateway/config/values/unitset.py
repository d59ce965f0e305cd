"""Unit sets: a number, a range such as "10-13", or a list of both."""

import re
from collections.abc import Iterable
from typing import Final, Literal

from gateway.config.problem import WrongValue
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT, SERVER_UNIT

#: The units of the gateway itself, and what is said of any other number.
_OWN_UNITS: Final = frozenset({*range(FIRST_UNIT, LAST_UNIT + 1), SERVER_UNIT})
_NO_OWN_UNIT: Final = f"neither {FIRST_UNIT}-{LAST_UNIT} nor {SERVER_UNIT}"

_RANGE = re.compile(r"([0-9]{1,20})(?:\s*-\s*([0-9]{1,20}))?")


def parse_units(value: object, first: int = FIRST_UNIT) -> tuple[int, ...]:
    """Parse the units of a set, in the order in which they are written."""
    units: list[int] = []
    for part in value if isinstance(value, list) else [value]:
        units += _parse_part(part, range(first, HIGHEST_UNIT + 1))
    if not units:
        raise WrongValue("names no unit")
    seen: set[int] = set()
    for unit in units:
        if unit in seen:
            raise WrongValue(f"names unit {unit} twice")
        seen.add(unit)
    return tuple(units)


def parse_unit0(value: object) -> Literal["refuse", "broadcast"] | int:
    """Parse what becomes of requests to unit 0."""
    if value == "refuse":
        return "refuse"
    if value == "broadcast":
        return "broadcast"
    if isinstance(value, int) and not isinstance(value, bool) and value in _OWN_UNITS:
        return value
    raise WrongValue('must be "refuse", "broadcast" or a unit, 1-247 or 255')


def check_own_unit(value: int) -> int:
    """Return a unit that the gateway can answer for itself."""
    if value not in _OWN_UNITS:
        raise WrongValue(f"{value} is {_NO_OWN_UNIT}")
    return value


def parse_units_or_none(value: object) -> tuple[int, ...]:
    """Parse a unit set, or "none", which has no unit."""
    return () if value == "none" else parse_units(value)


def parse_served_units(value: object) -> tuple[int, ...] | Literal["all"]:
    """Parse a unit set, or "all"."""
    return "all" if value == "all" else parse_units(value)


def parse_units_or_all(value: object) -> tuple[int, ...] | Literal["all"]:
    """Parse a unit set, or "all". Any from 0 to 255 is accepted: which are possible depends on other keys."""
    return "all" if value == "all" else parse_units(value, 0)


def show_units(units: Iterable[int]) -> str:
    """Show a unit set as text, ascending, neighbours joined: `1-3, 7`."""
    runs: list[list[int]] = []
    for unit in sorted(units):
        if runs and unit == runs[-1][1] + 1:
            runs[-1][1] = unit
        else:
            runs.append([unit, unit])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


def show_unit(unit: int | None) -> str:
    """Show the unit that clients use for a device; a dash for one that they ask by its name."""
    return "-" if unit is None else str(unit)


def _parse_part(part: object, allowed: range) -> range:
    low, high = _bounds(part)
    if low > high:
        raise WrongValue(f'"{part}" counts backwards', f'write "{high}-{low}"')
    for unit in (low, high):
        if unit not in allowed:
            # Where unit 0 is allowed it means something special: the message does not suggest it.
            raise WrongValue(f"unit {unit} is outside {FIRST_UNIT}-{HIGHEST_UNIT}")
    return range(low, high + 1)


def _bounds(part: object) -> tuple[int, int]:
    if isinstance(part, int) and not isinstance(part, bool):
        return part, part
    match = _RANGE.fullmatch(part.strip()) if isinstance(part, str) else None
    if match is None:
        raise WrongValue(f"{_shown(part)} is not a valid unit", 'units are written 5, "10-13", or as a list of both')
    return int(match[1]), int(match[2] or match[1])


def _shown(part: object) -> str:
    return f'"{part}"' if isinstance(part, str) else str(part).lower()
