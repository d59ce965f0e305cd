"""Checks of the rows of virtual units by themselves: which kind of row each is, and keys that it does not have."""

from collections.abc import Iterator
from typing import Final

from gateway.config.plan.map_rows import EVERY_POINT
from gateway.config.problem import Problem, error
from gateway.config.schema.image import Mapped
from gateway.modbus.codes import Area
from gateway.registers.datatypes import BYTE_TYPES

#: The keys that say what a row has, and those that only some rows have.
_SOURCES: Final = ("point", *Area)
_OF_VALUES: Final = ("point", *Area, "every", "type", "swap", "scale", "offset", "write", "when_stale")
_OF_CONVERSION: Final = ("type", "scale", "offset")
_EXAMPLE: Final = 'such as { at = 0, device = "meter-1", point = "power", every = "1 s" }'


def check_row(row: Mapped) -> Iterator[Problem]:
    """Find a row that is no kind of row, or more than one, and keys that do not belong to its kind."""
    kinds = [key for key in ("device", "fresh", "age") if row.has(key)]
    if len(kinds) != 1:
        what = (
            "must have one of device, fresh and age" if not kinds else f"has {' and '.join(kinds)}, and one is needed"
        )
        yield error(row.path, what, _EXAMPLE if not kinds else "make several rows of it")
        return
    if kinds == ["device"]:
        yield from _check_value(row)
    else:
        for key in filter(row.has, _OF_VALUES):
            yield error((*row.path, key), f"only a row with device has it, and this has {kinds[0]}", "take it out")
        if row.has("fresh") and not row.fresh:
            yield error((*row.path, "fresh"), "is empty", 'name devices of this map, such as ["meter-1"]')
    if isinstance(row.at, str):
        yield from _check_named_place(row)


def _check_value(row: Mapped) -> Iterator[Problem]:
    named = [key for key in _SOURCES if row.has(key)]
    if len(named) != 1:
        yield error(row.path, "must have one of point, holding, input, coils and discrete", _EXAMPLE)
    if not row.has("point"):
        for key in filter(row.has, _OF_CONVERSION):
            what = "registers of a range are as they are; only points have values"
            yield error((*row.path, key), what, "take it out, or name a point")
    if row.type is not None and (row.type in BYTE_TYPES or row.type == "bit"):
        yield error((*row.path, "type"), f"{row.type} is not all of a register", 'write "uint16" or "int16"')
    if row.scale == 0:
        yield error((*row.path, "scale"), "must not be 0: the value is divided by it")
    if row.type == "string":
        for key in ("scale", "offset"):
            if row.has(key):
                yield error((*row.path, key), "text has none", "take it out")


def _check_named_place(row: Mapped) -> Iterator[Problem]:
    """Find keys that say what the point of the profile says."""
    if row.point == EVERY_POINT:
        yield error((*row.path, "at"), "must be an address where several points are mapped")
    for key in ("area", "type", "swap", "scale", "offset"):
        if row.has(key):
            what = f'the point "{row.at}" of the profile says it'
            yield error((*row.path, key), what, "take it out, or write an address for at")
