"""Checks of the values of points: types that the place does not have, and keys that contradict the type."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from math import ceil, floor
from typing import Final

from gateway.config.checks.point_writing import ITEMS
from gateway.config.plan.points import bits_of, pattern, places_by_name, size_of, type_of
from gateway.config.problem import Problem, did_you_mean, error
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.values.ranges import show_ranges
from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range, covers, width_at
from gateway.registers.datatypes import BYTE_TYPES, bounds, is_whole, registers_of
from gateway.registers.items import REGISTER, has_bits

#: The types that a scale register may scale.
_TYPES_WITH_SCALE: Final = ("uint16", "int16", "uint32", "int32", "uint64", "int64")
#: The types whose bits may be values of their own.
_TYPES_WITH_BITS: Final = ("uint16", "uint32", "uint64")
_PARTS: Final = ("bit", "bits", "byte")


def check_type(table: PointTable, area: Area, width: int) -> Iterator[Problem]:
    """Find a type that the place cannot have, and parts that the type does not have."""
    path, data_type = table.path, type_of(table, area)
    parts = [key for key in _PARTS if getattr(table, key) is not None]
    if has_bits(area) and (parts or data_type != "bit"):
        key = parts[0] if parts else "type"
        yield error((*path, key), f"{ITEMS[area]} are bits", f"leave {key} out")
    elif not has_bits(area) and data_type == "bit":
        remedy = "read the whole register, and name its numbers with labels; or name one of its bits: bit = 3"
        yield error((*path, "type"), f"{ITEMS[area]} are no bits", remedy)
    elif data_type == "string" and table.length is None:
        yield error((*path, "type"), "a string needs its length", "add length = 8: the number of its registers")
    elif data_type != "string" and table.length is not None:
        yield error((*path, "length"), f"only a string has a length; {data_type} has its own", "take it out")
    elif len(parts) > 1:
        what = f"a point has one of {', '.join(_PARTS)}, and this one has {parts[0]}"
        yield error((*path, parts[1]), what, "take it out")
    elif parts:
        yield from _check_part(table, area, parts[0], data_type)
    elif width > REGISTER and data_type != "string" and registers_of(data_type) == 1:
        yield error((*path, "type"), f"the register has four bytes, and a {data_type} has fewer", 'write "uint32"')
    if table.swap in _useless_swaps(table, area):
        item = "bit" if has_bits(area) else "byte" if "bytes" in _useless_swaps(table, area) else "word"
        yield error((*path, "swap"), f"there is nothing to swap: the point is one {item}")


def check_value(table: PointTable, area: Area) -> Iterator[Problem]:
    """Find scale, decimals and limits at what is no number, and labels at what is no whole one."""
    data_type, bits = type_of(table, area), bits_of(table, area)
    is_bit = data_type == "bit" or (bits is not None and bits[0] == bits[1])
    called = "bit" if is_bit else data_type
    if table.scale == 0:
        yield error((*table.path, "scale"), "must not be 0")
    for key in ("scale", "offset", "decimals", "min", "max", "scale_from"):
        if table.has(key) and called in ("bit", "string"):
            yield error((*table.path, key), f"a {called} is no number to be scaled, rounded or limited", "take it out")
    if table.min is not None and table.max is not None and table.min > table.max:
        yield error((*table.path, "min"), f"is more than max, which is {table.max:g}")
    elif not is_bit and is_whole(data_type) and table.scale and table.scale_from is None:
        yield from _check_limits(table, data_type, bits)
    yield from _check_invalid(table, data_type)
    yield from _check_labels(table, data_type, bits)


def check_scale(
    table: PointTable, area: Area, addresses: Range, tables: Iterable[PointTable], profile: ProfileTable | None
) -> Iterator[Problem]:
    """Find a scale register that is none, or that cannot be read with its point. `tables` are those of the unit."""
    if table.scale_from is None:
        return
    path, others = (*table.path, "scale_from"), {each[0]: each[1:] for each in places_by_name(tables)}
    if table.scale_from not in others:
        yield error(path, f'there is no point "{table.scale_from}"', did_you_mean(table.scale_from, others))
        return
    scale, its_area, at = others[table.scale_from]
    if its_area != area or type_of(scale, its_area) != "int16" or not _is_plain(scale):
        yield error(path, f"{table.scale_from} is no {area} register of type int16 with the plain number")
    elif scale.write == "only":
        yield error(path, f"{table.scale_from} is only written, and a scale is read")
    elif table.write == "only":
        yield error(path, "is read together with its point, which is only written", "take it out, or write = true")
    elif type_of(table, area) not in _TYPES_WITH_SCALE or bits_of(table, area) is not None:
        yield error(path, f"a {type_of(table, area)} has no scale register", "take it out")
    elif table.write != "no" and (table.min is not None or table.max is not None):
        what = "limits cannot be guarded: what is written depends on a register that the device may change"
        yield error(path, what, "take min and max out, or write")
    else:
        size, (first, last) = size_of(table, area), addresses
        of_ends = (Span(area, start, size).up_to(at) for start in (first, max(first, last - size + 1)))
        yield from [problem for span in of_ends for problem in _check_distance(table, span, profile)][:1]


def _is_plain(scale: PointTable) -> bool:
    return scale.scale_from is None and scale.scale == 1 and not scale.offset and scale.swap == "none"


def _check_distance(table: PointTable, span: Span, profile: ProfileTable | None) -> Iterator[Problem]:
    """Find a scale register that no request can read together with its point."""
    path, (function, most) = (*table.path, "scale_from"), READERS[span.area]
    exist: tuple[Range, ...] | None = None
    if profile is not None:
        exist, most = getattr(profile, span.area), min(most, profile.limits.get(function, most))
    if span.count > most:
        yield error(path, f"is {span.count} registers away, and one request reads {most}", "they are read together")
    elif not covers(exist, span):
        what = f"is read together with its point, and the profile has no {span.area} {span.start}-{span.end - 1}"
        yield error(path, what, f"it has {show_ranges(exist or ())}")
    elif profile is not None and width_at(profile.wide, span) is None:
        what = f"is read together with its point, and only some of {span.area} {span.addresses} have four bytes"
        yield error(path, what)


def _check_part(table: PointTable, area: Area, part: str, data_type: str) -> Iterator[Problem]:
    _, last = bits_of(table, area) or (0, 0)
    if part == "byte":
        if data_type not in (*BYTE_TYPES, "string"):
            yield error((*table.path, "type"), "a byte is uint8 or int8, or one of each register of a string")
    elif data_type not in _TYPES_WITH_BITS:
        known = ", ".join(_TYPES_WITH_BITS)
        yield error((*table.path, part), f"a {data_type} has no bits to name", f"types with bits are {known}")
    elif last >= 16 * registers_of(data_type):
        what = f"a {data_type} has the bits 0 to {16 * registers_of(data_type) - 1}"
        yield error((*table.path, part), what, "0 is the lowest one")


def _check_limits(table: PointTable, data_type: str, bits: Range | None) -> Iterator[Problem]:
    """Find limits that no value of the point is within."""
    lowest, highest = sorted(number * table.scale + table.offset for number in bounds(data_type, bits))
    if table.min is not None and table.min > highest:
        yield error((*table.path, "min"), f"is more than the highest value that the point can have: {highest:g}")
    if table.max is not None and table.max < lowest:
        yield error((*table.path, "max"), f"is less than the lowest value that the point can have: {lowest:g}")
    elif table.min is not None and table.max is not None:
        scale, offset = Fraction(repr(table.scale)), Fraction(repr(table.offset))
        of, to = sorted((Fraction(repr(limit)) - offset) / scale for limit in (table.min, table.max))
        if ceil(of) > floor(to):
            what = f"no value of the point is from {table.min:g} to {table.max:g}: it has steps of {abs(table.scale):g}"
            yield error((*table.path, "max"), what)


def _check_invalid(table: PointTable, data_type: str) -> Iterator[Problem]:
    if table.invalid and data_type in ("bit", "string"):
        yield error((*table.path, "invalid"), f"a {data_type} always has a value", "take it out")
        return
    for number in table.invalid:
        if not _fits(number, data_type):
            room = ": {} to {}".format(*bounds(data_type)) if is_whole(data_type) else ""
            yield error((*table.path, "invalid"), f"{number:g} does not fit into {data_type}{room}")


def _fits(number: float, data_type: str) -> bool:
    try:
        carried = pattern(number, data_type)
    except OverflowError:
        return False
    least, greatest = bounds(data_type) if is_whole(data_type) else (carried, carried)
    return least <= carried <= greatest and (not is_whole(data_type) or carried == int(carried))


def _check_labels(table: PointTable, data_type: str, bits: Range | None) -> Iterator[Problem]:
    if not table.labels:
        return
    if not is_whole(data_type):
        yield error((*table.path, "labels"), f"labels are for whole numbers, and a {data_type} is none")
        return
    least, greatest = bounds(data_type, bits)
    numbers = [int(pattern(number, data_type)) for number in table.labels]
    called = data_type if bits is None or data_type in BYTE_TYPES else f"bits {bits[0]}-{bits[1]}"
    strange = next((number for number in numbers if not least <= number <= greatest), None)
    if strange is not None:
        yield error((*table.path, "labels"), f"{strange} does not fit into {called}: {least} to {greatest}")
    elif len(set(numbers)) < len(numbers):
        yield error((*table.path, "labels"), "two of the numbers are the same in a register")


def _useless_swaps(table: PointTable, area: Area) -> tuple[str, ...]:
    if has_bits(area):
        return ("words", "bytes", "both")
    data_type = type_of(table, area)
    if data_type in BYTE_TYPES or table.byte is not None:
        return ("words", "bytes", "both")
    return ("words", "both") if (table.length or registers_of(data_type)) == 1 else ()
