"""Amounts of memory or of disk: text with a unit, such as "4 MiB"."""

import re
from typing import Final

from gateway.config.problem import WrongValue

_UNITS: Final = {"KiB": 2**10, "MiB": 2**20, "GiB": 2**30}
#: The memory of the last transactions, if the config does not say.
DEFAULT_RING: Final = 4 * 2**20
#: Less would hold a moment, and more be the machine's whole memory, or its disk.
_LEAST: Final = 2**16
_MOST: Final = 2**30

_SIZE = re.compile(r"(\d{1,9}(?:\.\d{1,3})?)\s*([A-Za-z]*)")


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
    if unit not in _UNITS:
        raise WrongValue(f'"{unit}" is not a valid unit of size', 'the units are KiB, MiB and GiB: "4 MiB"')
    size = int(number * _UNITS[unit])
    if not _LEAST <= size <= _MOST:
        raise WrongValue(f"must be {show_size(_LEAST)} to {show_size(_MOST)}, or 0 for none")
    return size


def show_size(size: int) -> str:
    """Show a size as a person would write it."""
    unit = next((unit for unit in reversed(_UNITS) if size >= _UNITS[unit]), "")
    return f"{size / _UNITS[unit]:g} {unit}" if unit else str(size)
