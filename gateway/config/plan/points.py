"""The points that tables of the config describe."""

from collections.abc import Iterable, Iterator

from gateway.config.plan.areas import places_of
from gateway.config.schema.profile import PointTable
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Range
from gateway.registers.datatypes import registers_of
from gateway.registers.items import has_bits


def points_of(tables: Iterable[PointTable]) -> tuple[Point, ...]:
    """Make the points of tables that have passed their checks, in their order."""
    return tuple(point for table in tables for point in _points(table))


def type_of(table: PointTable, area: Area) -> str:
    """Tell the type of a table's points in an area."""
    return table.type or ("bit" if has_bits(area) else "uint16")


def size_of(table: PointTable, area: Area) -> int:
    """Tell how many coils or registers each point takes."""
    return 1 if has_bits(area) else table.length or registers_of(type_of(table, area))


def names_of(table: PointTable, area: Area, addresses: Range) -> Iterator[str]:
    """List the names of a table's points."""
    first, last = addresses
    number, size = first if table.first is None else table.first, size_of(table, area)
    if not is_range(table, area, addresses):
        yield table.name
    else:
        for index in range((last - first + 1) // size):
            yield table.name.replace("*", str(number + index * (size if table.first is None else 1)))


def is_range(table: PointTable, area: Area, addresses: Range) -> bool:
    """Tell whether the addresses are those of several points; the first one alone stands for a whole value."""
    first, last = addresses
    return last > first and last - first + 1 != size_of(table, area)


def _points(table: PointTable) -> Iterator[Point]:
    for area, addresses in places_of(table):
        size = size_of(table, area)
        for index, name in enumerate(names_of(table, area, addresses)):
            yield Point(
                name=name,
                area=area,
                address=addresses[0] + index * size,
                type=type_of(table, area),
                swap=table.swap,
                count=size,
                scale=table.scale,
                decimals=table.decimals,
                unit=table.unit,
                labels=table.labels,
                write=table.write,
            )
