"""Ranges of addresses: a count from address 0, a range "1-99", or a list of ranges."""

import re
from collections.abc import Iterable
from typing import Final

from gateway.config.problem import WrongValue
from gateway.profiles.profile import Range

#: Addresses have 16 bits (A 4.4).
MOST_ITEMS: Final = 65536

_ADDRESS = "[0-9]{1,20}|0[xX][0-9A-Fa-f]{1,16}"
_RANGE = re.compile(rf"({_ADDRESS})(?:\s*-\s*({_ADDRESS}))?")


def parse_ranges(value: object) -> tuple[Range, ...]:
    """Parse the ranges that `value` names: ascending, and those that touch joined."""
    if isinstance(value, int) and not isinstance(value, bool):
        return _from_zero(value)
    return join_ranges([_parse_range(part) for part in (value if isinstance(value, list) else [value])])


def parse_addresses(value: object) -> tuple[Range, ...]:
    """Parse ranges as `parse_ranges` does, but no count: where others write a unit it reads as an address."""
    if isinstance(value, int) and not isinstance(value, bool) and 0 < value <= MOST_ITEMS:
        raise WrongValue("could be a count or an address", f'write "0-{value - 1}", or "{value}" for one address')
    if value in (0, []):
        raise WrongValue("names no address", 'write a range such as "0-99", or leave the key out')
    return parse_ranges(value)


def show_ranges(ranges: tuple[Range, ...]) -> str:
    """Show ranges as text: `0-9, 20-29`, or `none`."""
    return ", ".join(f"{first}-{last}" for first, last in ranges) or "none"


def is_range(text: str) -> bool:
    """Tell whether a text has the form of an address or a range of addresses."""
    return _RANGE.fullmatch(text.strip()) is not None


def join_ranges(ranges: Iterable[Range]) -> tuple[Range, ...]:
    """Sort ranges, and join those that touch."""
    joined: list[Range] = []
    for first, last in sorted(ranges):
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = joined[-1][0], max(last, joined[-1][1])
        else:
            joined.append((first, last))
    return tuple(joined)


def _from_zero(count: int) -> tuple[Range, ...]:
    if not 0 <= count <= MOST_ITEMS:
        raise WrongValue(f"a count is 0 to {MOST_ITEMS}")
    return ((0, count - 1),) if count else ()


def _parse_range(part: object) -> Range:
    match = _RANGE.fullmatch(part.strip()) if isinstance(part, str) else None
    if match is None:
        raise WrongValue("is not a valid range of addresses", 'write a range such as "0-99", or a list of ranges')
    first, last = _address(match[1]), _address(match[2] or match[1])
    if first > last:
        raise WrongValue(f'"{part}" counts backwards', f'write "{last}-{first}"')
    if last >= MOST_ITEMS:
        raise WrongValue(f"address {last} is above {MOST_ITEMS - 1}")
    return first, last


def _address(text: str) -> int:
    return int(text, 16 if "x" in text.lower() else 10)
