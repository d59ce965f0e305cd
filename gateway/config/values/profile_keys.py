"""The keys of a kind of device: how it is recognised, and which of its registers are wide."""

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


def parse_wide(value: object) -> dict[Area, tuple[Range, ...]]:
    """Parse which registers have four bytes: `{ holding = "5000-5999" }`, or `"all"` in place of addresses.

    Raises:
        WrongValue: it names another area, or no addresses.
    """
    if value == "all":
        return dict.fromkeys(_REGISTER_AREAS, _ALL)
    if not isinstance(value, Mapping) or not value:
        raise WrongValue("must be a table", 'write it as { holding = "5000-5999" }, or "all"')
    strange = next((key for key in value if key not in _REGISTER_AREAS), None)
    if strange is not None:
        raise WrongValue(f"{strange} has no registers", "holding and input have")
    return {Area(key): _ALL if part == "all" else parse_ranges(part) for key, part in value.items()}


def parse_identity(value: object) -> Identity:
    """Parse what tells that a unit is of this kind.

    Raises:
        WrongValue: it is none of the three.
    """
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
