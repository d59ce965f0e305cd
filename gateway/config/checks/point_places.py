"""Checks of the places of points: addresses that do not exist, and ranges that are no whole number of values."""

from collections.abc import Iterator, Mapping
from typing import Final

from gateway.config.plan.points import is_range, size_of
from gateway.config.problem import Path, Problem, error
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.values.ranges import MOST_ITEMS, show_ranges
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range, covers, width_at

#: The items of each area, in words.
ITEMS: Final[Mapping[Area, str]] = {
    Area.COILS: "coils",
    Area.DISCRETE: "discrete inputs",
    Area.INPUT: "input registers",
    Area.HOLDING: "holding registers",
}


def check_place(
    table: PointTable, area: Area, addresses: Range, profile: ProfileTable | None, width: int
) -> Iterator[Problem]:
    """Find addresses that the profile does not have, or that do not fit the type or the name."""
    first, last = addresses
    size, several = size_of(table, area, width), is_range(table, area, addresses, width)
    path, end = (*table.path, area), last if several else first + size - 1
    span = Span(area, first, end - first + 1)
    if end >= MOST_ITEMS:
        yield error(path, f"the point ends at {end}, and the last address is {MOST_ITEMS - 1}")
    elif several and (last - first + 1) % size:
        whole = first + (last - first + 1) // size * size - 1
        remedy = f'write "{first}-{whole if whole > first else first + size - 1}"'
        yield error(path, f"{last - first + 1} registers are no whole number of values of {size}", remedy)
    else:
        yield from check_ranges(path, span, profile)
        if profile is not None and width_at(profile.wide, span) != width:
            yield error(path, "only some of its registers are wide, which have four bytes")
    if several != ("*" in table.name):
        what = "several points need several names" if several else "* stands for a number, and this is one point"
        yield error((*table.path, "name"), what, f'write "{table.name}-*"' if several else "take it out")
    if table.first is not None and not several:
        yield error((*table.path, "first"), "only a range of points has it", "take it out")


def check_ranges(path: Path, span: Span, profile: ProfileTable | None) -> Iterator[Problem]:
    """Find addresses that the profile does not have."""
    exist: tuple[Range, ...] | None = None if profile is None else getattr(profile, span.area)
    if not covers(exist, span):
        addresses = f"{span.start}-{span.end - 1}"
        yield error(path, f"the profile has no {span.area} {addresses}, but {show_ranges(exist or ())}")
