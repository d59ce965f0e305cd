"""The keys of a point, and of a row of a virtual unit: name, place, labels, and whether it can be written."""

import re
from sys import float_info

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.names import LONGEST_NAME
from gateway.config.values.ranges import MOST_ITEMS, is_range, parse_ranges
from gateway.images.virtual.settings import WhenStale
from gateway.modbus.codes import Area
from gateway.profiles.point import Writing
from gateway.profiles.profile import Range

_WHOLE_NUMBER = re.compile(r"-?(?:[0-9]{1,20}|0[xX][0-9A-Fa-f]{1,16})")
_BITS = re.compile(r"([0-9]{1,2})-([0-9]{1,2})")
#: The most bits of a value, and the most numbers that may mean "no value".
_MOST_BITS = 64
_MOST_INVALID = 16
#: With a star, which stands for a number.
_POINT_NAME = re.compile(r"[^\W\d_][\w.*-]*")


def parse_point_name(value: object) -> str:
    """Parse the name of a point, which is typed behind a command and becomes a part of topics."""
    if not isinstance(value, str):
        raise NotText
    if not _POINT_NAME.fullmatch(value) or len(value) > LONGEST_NAME:
        what = f'"{value}" is no name of a point'
        raise WrongValue(what, f"letters, digits, - _ and . are allowed, a letter first, at most {LONGEST_NAME}")
    if value in set(Area):
        raise WrongValue(f'"{value}" is the name of an area', "choose another name")
    return value


def parse_point_addresses(value: object) -> Range:
    """Parse where a point is: an address, or first and last of several points."""
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    if not isinstance(value, str) or not is_range(value):
        raise WrongValue("is no address", 'write an address such as 16, or a range "1-99" for several points')
    (addresses,) = parse_ranges(value)
    return addresses


def parse_labels(value: object) -> dict[int, str]:
    """Parse what numbers mean, as in `{ 0 = "off", 1 = "running" }`."""
    if not isinstance(value, dict):
        raise WrongValue("must be a table", 'write it as { 0 = "off", 1 = "running" }')
    labels: dict[int, str] = {}
    for text, label in value.items():
        if not _WHOLE_NUMBER.fullmatch(text):
            raise WrongValue(f'"{text}" is no whole number', 'labels are for numbers: { 0 = "off", 1 = "running" }')
        if not isinstance(label, str) or not label.strip():
            raise WrongValue(f"the label of {text} must be text", f'write {text} = "running"')
        number = int(text, 16 if "x" in text.lower() else 10)
        if number in labels:
            raise WrongValue(f"{number} is there twice")
        if label in labels.values():
            raise WrongValue(f'"{label}" is there twice')
        labels[number] = label
    return labels


def parse_invalid(value: object) -> tuple[float, ...]:
    """Parse the encoded numbers that mean that there is no value: one, or a list."""
    numbers = value if isinstance(value, list) else [value]
    if not numbers or not all(map(_is_number, numbers)):
        raise WrongValue("must be a number or a list of numbers", "write it as 0x8000, or as [0x7FFF, 0x8000]")
    if len(numbers) > _MOST_INVALID:
        raise WrongValue(f"has more than {_MOST_INVALID} numbers")
    return tuple(numbers)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= float_info.max


def parse_bits(value: object) -> Range:
    """Parse which bits of a register belong to a value: `"4-6"`."""
    match = _BITS.fullmatch(value) if isinstance(value, str) else None
    first, last = (int(match[1]), int(match[2])) if match is not None else (0, _MOST_BITS)
    if not first <= last < _MOST_BITS:
        raise WrongValue("is no range of bits", 'write bits = "4-6"; 0 is the lowest, and bit = 3 is a single one')
    return first, last


def parse_writing(value: object) -> Writing:
    """Parse whether a point can be written."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value == "only":
        return "only"
    remedy = "true and false have no quotes" if isinstance(value, str) else ""
    raise WrongValue('must be true, false or "only"', remedy)


def parse_map_place(value: object) -> int | str:
    """Parse where a row is in its unit: an address, or the name of a point."""
    if isinstance(value, int) and not isinstance(value, bool):
        if 0 <= value < MOST_ITEMS:
            return int(value)
        raise WrongValue(f"addresses are 0 to {MOST_ITEMS - 1}")
    if not isinstance(value, str) or not value:
        raise WrongValue("must be an address, or the name of a point of the profile")
    if is_range(value):
        raise WrongValue("an address has no quotes", f"write at = {value.partition('-')[0].strip()}")
    return value


def parse_when_stale(value: object) -> WhenStale:
    """Parse what a read gets of a stale value."""
    if value == "exception":
        return "exception"
    if value == "hold":
        return "hold"
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 0xFFFF:
        return int(value)
    raise WrongValue('must be "exception", "hold" or a number', "a number 0-65535 is what each register has then")
