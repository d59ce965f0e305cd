"""The points that tables of the config describe, and what these tables say of each of the four areas."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from gateway.config.schema.image import Image, InitialValues, Polled
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, width_at
from gateway.registers.datatypes import BYTE_TYPES, bounds, is_whole, registers_of, shortest
from gateway.registers.items import REGISTER, has_bits

#: The bits of a byte in its register.
_BYTES: Mapping[str, Range] = {"low": (0, 7), "high": (8, 15)}
#: The areas, each with its key as plain text, which is found quicker.
_KEYS: Final = tuple((area, area.value) for area in Area)


def ranges_in(area: Area, table: Image | Polled | ProfileTable) -> tuple[Range, ...]:
    """List the addresses that a table names in an area; empty if it has no key for it."""
    ranges: tuple[Range, ...] | None = getattr(table, area)
    return ranges or ()


def initial_values(area: Area, image: Image) -> tuple[InitialValues, ...]:
    """List the initial values of an area."""
    rows: tuple[InitialValues, ...] = getattr(image.initial, area)
    return rows


def places_of(point: PointTable) -> tuple[tuple[Area, Range], ...]:
    """List the areas of a point, with its addresses there; a table that has passed its checks has one."""
    return tuple((area, found) for area, key in _KEYS if (found := getattr(point, key)) is not None)


def points_of(tables: Iterable[PointTable], kind: ProfileTable) -> tuple[Point, ...]:
    """Make the points of tables that have passed their checks, in their order: those of a kind of device, or more."""
    tables = tuple(tables)
    scales = {name: address for name, _, _, address in places_by_name((*kind.points, *tables))}
    return tuple(point for table in tables for point in _points(table, kind, scales))


def type_of(table: PointTable, area: Area) -> str:
    """Tell the type of a table's points in an area."""
    return table.type or ("bit" if has_bits(area) else "uint8" if table.byte else "uint16")


def width_of(area: Area, first: int, kind: ProfileTable | None) -> int:
    """Tell how many bytes a register of a kind of device has."""
    return REGISTER if kind is None else width_at(kind.wide, Span(area, first, 1)) or REGISTER


def size_of(table: PointTable, area: Area, width: int = REGISTER) -> int:
    """Tell how many coils or registers of this width each point takes."""
    return 1 if has_bits(area) else table.length or registers_of(type_of(table, area), width)


def bits_of(table: PointTable, area: Area) -> Range | None:
    """Tell which bits of its registers belong to a point, if not all do."""
    if table.bit is not None:
        return table.bit, table.bit
    if table.byte is not None or type_of(table, area) in BYTE_TYPES:
        return _BYTES[table.byte or "low"]
    return table.bits


def pattern(number: float, data_type: str) -> float:
    """Find the number of a type with the same bits: 0x8000 of an int16 is -32768, 3.40282347e38 the largest float32.

    Others stay as they are.

    Raises:
        OverflowError: no float32 is so large.
    """
    if data_type == "float32":
        return shortest(number)
    if not is_whole(data_type) or not isinstance(number, int):
        return number
    least, greatest = bounds(data_type)
    return number + 2 * least if least < 0 and greatest < number <= greatest - least else number


def names_of(table: PointTable, area: Area, addresses: Range, width: int = REGISTER) -> Iterator[str]:
    """List the names of a table's points."""
    first, last = addresses
    number, size = first if table.first is None else table.first, size_of(table, area, width)
    if not is_range(table, area, addresses, width):
        yield table.name
    else:
        for index in range((last - first + 1) // size):
            yield table.name.replace("*", str(number + index * (size if table.first is None else 1)))


def is_range(table: PointTable, area: Area, addresses: Range, width: int = REGISTER) -> bool:
    """Tell whether the addresses are those of several points; the first one alone stands for a whole value."""
    first, last = addresses
    return last > first and last - first + 1 != size_of(table, area, width)


def places_by_name(tables: Iterable[PointTable]) -> Iterator[tuple[str, PointTable, Area, int]]:
    """Yield name, table, area and address of each point: one may be the scale of another."""
    for table in tables:
        for area, addresses in places_of(table)[:1]:
            for index, name in enumerate(names_of(table, area, addresses)):
                yield name, table, area, addresses[0] + index * size_of(table, area)


def _points(table: PointTable, kind: ProfileTable, scales: Mapping[str, int]) -> Iterator[Point]:
    for area, addresses in places_of(table):
        width, data_type = width_of(area, addresses[0], kind), type_of(table, area)
        size = size_of(table, area, width)
        for index, name in enumerate(names_of(table, area, addresses, width)):
            yield Point(
                name=name,
                area=area,
                address=addresses[0] + index * size,
                type=data_type,
                swap=table.swap,
                count=size,
                scale=table.scale,
                decimals=table.decimals,
                unit=table.unit,
                labels={int(pattern(number, data_type)): label for number, label in table.labels.items()},
                write=table.write,
                offset=table.offset,
                invalid=tuple(pattern(number, _judged_type(table, data_type)) for number in table.invalid),
                bits=bits_of(table, area),
                minimum=table.min,
                maximum=table.max,
                write_at=None if table.write_at is None else table.write_at + index * size,
                write_function=table.write_function or kind.write_function,
                scale_at=None if table.scale_from is None else scales.get(table.scale_from),
                width=width,
            )


def _judged_type(table: PointTable, data_type: str) -> str:
    """Tell the type whose numbers `invalid` are; where only bits count it is that of the register, without a sign."""
    return "uint64" if table.bit is not None or table.bits is not None else data_type
