"""The keys of a kind of device: identity, wide registers, limits; and what a register of an image holds at first."""

import re
from collections.abc import Mapping
from typing import Final

from gateway.config.problem import WrongValue
from gateway.config.values.ranges import MOST_ITEMS, parse_ranges
from gateway.modbus.codes import Area
from gateway.profiles.identity import Identity, RegisterIdentity
from gateway.profiles.profile import Range

_REGISTER_AREAS: Final = (Area.HOLDING, Area.INPUT)
_ALL: Final[tuple[Range, ...]] = ((0, MOST_ITEMS - 1),)
_IDENTITY: Final = 'write { fc43 = "Model" }, { holding = 0, equals = 0x1234 } or { sunspec = [1, 103] }'
_FUNCTION = re.compile(r"[0-9]{1,9}")


def parse_wide(value: object) -> dict[Area, tuple[Range, ...]]:
    """Parse which registers have four bytes: `{ holding = "5000-5999" }`, or `"all"` in place of addresses."""
    if value == "all":
        return dict.fromkeys(_REGISTER_AREAS, _ALL)
    if not isinstance(value, Mapping) or not value:
        raise WrongValue("must be a table", 'write it as { holding = "5000-5999" }, or "all"')
    strange = next((key for key in value if key not in _REGISTER_AREAS), None)
    if strange is not None:
        raise WrongValue(f"{strange} has no registers", "holding and input have")
    return {Area(key): _ALL if part == "all" else parse_ranges(part) for key, part in value.items()}


def parse_identity(value: object) -> Identity:
    """Parse what tells that a unit is of this kind."""
    if not isinstance(value, Mapping):
        raise WrongValue("must be a table", _IDENTITY)
    match dict(value):
        case {"fc43": str(text), **rest} if text.strip() and not rest:
            return Identity(fc43=text)
        case {"sunspec": list(models), **rest} if models and all(map(_is_register, models)) and not rest:
            return Identity(sunspec=tuple(models))
        case {"equals": int(equals), **rest} if _is_register(equals) and len(rest) == 1:
            ((area, address),) = rest.items()
            if area in _REGISTER_AREAS and _is_register(address):
                return Identity(register=RegisterIdentity(Area(area), address, equals))
    raise WrongValue("does not tell one kind of device from others", _IDENTITY)


def _is_register(number: object) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and 0 <= number < MOST_ITEMS


def parse_item(value: object) -> int:
    """Parse what a register or a coil holds at first: 0 to 65535, or true and false."""
    if isinstance(value, int) and 0 <= value <= 0xFFFF:
        return int(value)
    raise WrongValue("must be 0 to 65535, or for coils true or false")


def parse_limits(value: object) -> dict[int, int]:
    """Parse the most items by function, as in `{ 3 = 99 }`."""
    if not isinstance(value, dict):
        raise WrongValue("must be a table", "write it as { 3 = 99 }: at most 99 items of function 3")
    limits: dict[int, int] = {}
    for text, most in value.items():
        function = _function_number(text)
        if function in limits:
            raise WrongValue(f"function {function} is there twice")
        limits[function] = _quantity(text, most)
    return limits


def _function_number(text: str) -> int:
    if _FUNCTION.fullmatch(text) and 1 <= int(text) <= 127:
        return int(text)
    raise WrongValue(f'"{text}" is not a valid function number', "functions are numbered 1 to 127")


def _quantity(function: str, most: object) -> int:
    if isinstance(most, int) and not isinstance(most, bool) and most >= 1:
        return most
    raise WrongValue(f"the limit of function {function} must be a whole number from 1")
