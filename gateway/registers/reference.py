"""Reference numbers of coils and registers in manuals: a digit for the area, then a number from 1."""

from collections.abc import Mapping
from typing import Final

from gateway.modbus.codes import Area

#: The digit of each area.
DIGITS: Final[Mapping[Area, str]] = {Area.COILS: "0", Area.DISCRETE: "1", Area.INPUT: "3", Area.HOLDING: "4"}

#: The first address of an area in manuals that count addresses so too.
MANUAL_BASES: Final[Mapping[Area, int]] = {Area.HOLDING: 40001, Area.INPUT: 30001, Area.DISCRETE: 10001}


def reference(area: Area, address: int) -> str:
    """The reference number of a 0-based protocol address: holding 107 is 40108, holding 9999 is 410000."""
    return f"{DIGITS[area]}{address + 1:04}"


def place_of(number: str) -> tuple[Area, int] | None:
    """The area and the protocol address of a reference number with five or six digits; None if it is none."""
    area = next((area for area, digit in DIGITS.items() if number.startswith(digit)), None)
    if area is None or not number.isdecimal() or len(number) not in (5, 6) or not 1 <= int(number[1:]) <= 65536:
        return None
    return area, int(number[1:]) - 1
