"""Durations, such as "250 ms", "5 s" or "10 min", and amounts of memory or disk, such as "4 MiB": text with a unit."""

import re
from collections.abc import Callable
from typing import Final

from gateway.config.problem import WrongValue

_UNITS: Final = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0, "day": 86400.0, "days": 86400.0}

#: The longest duration: a week.
_LONGEST: Final = 7 * 24 * 3600.0
#: The shortest useful duration. Less is usually a wrong unit.
SHORTEST: Final = 0.001

#: Other ways to write "off", in lower case.
_MEANT_OFF: Final = (False, 0, "off", "never", "none", "no", "false", "0", "0 ms", "0 s")

_DURATION = re.compile(r"(\d+(?:\.\d+)?)\s*([A-Za-z]*)")
_SIZES: Final = {"KiB": 2**10, "MiB": 2**20, "GiB": 2**30}
#: The memory of the last transactions, if the config does not say.
DEFAULT_RING: Final = 4 * 2**20
#: Less would hold a moment, and more be the machine's whole memory, or its disk.
_LEAST: Final = 2**16
_MOST: Final = 2**30

_SIZE = re.compile(r"(\d{1,9}(?:\.\d{1,3})?)\s*([A-Za-z]*)")


def parse_duration(value: object, least: float = SHORTEST, most: float = _LONGEST) -> float:
    """Parse seconds, more than 0, `least` or more, and at `most` so many."""
    seconds = parse_duration_or_zero(value, least)
    if seconds == 0:
        raise WrongValue("must be longer than 0")
    if seconds > most:
        raise WrongValue(f"must be at most {show_duration(most)}")
    return seconds


def parse_duration_or_zero(value: object, least: float = 0.0) -> float:
    """Parse seconds, `least` or more, or zero. Zero needs no unit: "0"."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise WrongValue("a duration needs a unit", f'put it in quotes with a unit: "{value} ms" or "{value} s"')
    if not isinstance(value, str):
        raise WrongValue("must be a duration", 'a duration is text with a unit, such as "250 ms"')
    match = _DURATION.fullmatch(value.strip())
    if match is None:
        raise WrongValue(f'"{value}" is not a valid duration', 'a duration is a number and a unit, such as "250 ms"')
    seconds = _seconds(match[1], match[2])
    if 0 < seconds < least:
        raise WrongValue(f"must be at least {show_duration(least)}")
    return seconds


def parse_rs485_delay(value: object) -> tuple[int, int]:
    """Parse the delays of a driver before and after sending, in milliseconds; Linux knows whole ones, to 100."""
    if not isinstance(value, list) or len(value) != 2:
        raise WrongValue("must be two durations", 'such as ["1 ms", "0 ms"]: before the first bit, after the last one')
    before, after = (1000 * parse_duration_or_zero(each) for each in value)
    if max(before, after) > 100 or not (round(before, 6).is_integer() and round(after, 6).is_integer()):
        raise WrongValue("must be whole milliseconds, 100 at most")
    return round(before), round(after)


def _or_auto(parse: Callable[[object], float]) -> Callable[[object], float | None]:
    """Make a function that parses a duration, or returns None for "auto"."""
    return lambda value: None if value == "auto" else parse(_no_word(value, '"auto"'))


parse_duration_or_auto = _or_auto(parse_duration)
parse_duration_or_zero_or_auto = _or_auto(parse_duration_or_zero)


def parse_duration_or_off_or_auto(value: object) -> float | None:
    """Parse seconds, 0 for "off", or None for "auto"."""
    if value == "off":
        return 0.0
    if value in _MEANT_OFF or (isinstance(value, str) and value.strip().lower() in _MEANT_OFF):
        raise WrongValue('must be a duration, "auto" or "off"', 'did you mean "off"?')
    return None if value == "auto" else parse_duration(_no_word(value, '"auto", "off"'))


def show_duration(seconds: float | None) -> str:
    """Show a duration: the unit with the fewest digits, three significant ones; "auto" for None."""
    if seconds is None:
        return "auto"
    if seconds == 0:
        return "0"
    if seconds < 1:
        return f"{_three_figures(seconds * 1000)} ms"
    if seconds >= 24 * 3600 and seconds % 3600 == 0:
        return f"{seconds / 3600:.0f} h"
    if seconds >= 60 and seconds % 60 == 0:
        return f"{seconds / 60:.0f} min"
    return f"{_three_figures(seconds)} s"


def _no_word(value: object, words: str) -> object:
    """Return the value, unless it is text that should be one of the `words`."""
    if isinstance(value, str) and _DURATION.fullmatch(value.strip()) is None:
        raise WrongValue(
            f'"{value}" is not a valid duration', f'write {words}, or a number and a unit, such as "250 ms"'
        )
    return value


def _seconds(number: str, unit: str) -> float:
    if not unit and float(number) == 0:
        return 0.0
    if not unit:
        raise WrongValue("a duration needs a unit", f'write "{number} ms" or "{number} s"')
    if unit not in _UNITS:
        raise WrongValue(f'"{unit}" is not a valid unit of time', "the units are ms, s, min, h and days")
    seconds = float(number) * _UNITS[unit]
    if seconds > _LONGEST:
        raise WrongValue(f"must be at most {_LONGEST / 86400:g} days")
    return seconds


def _three_figures(number: float) -> str:
    digits = 2 if number < 10 else 1 if number < 100 else 0
    text = f"{number:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def show_age(milliseconds: float) -> str:
    """Show elapsed time as one number and unit: `3 s`, `2 h`."""
    seconds = milliseconds / 1000
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def parse_size_or_zero(value: object) -> int:
    """Parse bytes, or zero. Zero needs no unit: "0"."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        remedy = f'put it in quotes with a unit: "{value} MiB"' if value else 'write "0"'
        raise WrongValue("a size needs a unit", remedy)
    match = _SIZE.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        raise WrongValue(f'"{value}" is not a valid size', 'a size is a number and a unit, such as "4 MiB"')
    number, unit = float(match[1]), match[2]
    if number == 0:
        return 0
    if not unit:
        raise WrongValue("a size needs a unit", f'write "{match[1]} MiB"')
    if unit not in _SIZES:
        raise WrongValue(f'"{unit}" is not a valid unit of size', 'the units are KiB, MiB and GiB: "4 MiB"')
    size = int(number * _SIZES[unit])
    if not _LEAST <= size <= _MOST:
        raise WrongValue(f"must be {show_size(_LEAST)} to {show_size(_MOST)}, or 0 for none")
    return size


def show_size(size: int) -> str:
    """Show a size as a person would write it."""
    unit = next((unit for unit in reversed(_SIZES) if size >= _SIZES[unit]), "")
    return f"{size / _SIZES[unit]:g} {unit}" if unit else str(size)
