"""Checks of where points are, and how they are read and written: addresses, functions, length of requests."""

from collections.abc import Iterator, Mapping
from typing import Final

from gateway.config.plan.points import bits_of, is_range, size_of
from gateway.config.problem import Path, Problem, error
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.values.ranges import MOST_ITEMS, show_ranges
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range, covers, width_at
from gateway.registers.items import MOST_WIDE, REGISTER, WRITERS, has_bits

_MASK_WRITE = FunctionCode.MASK_WRITE_REGISTER
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


def check_reading(table: PointTable, area: Area, profile: ProfileTable | None, width: int) -> Iterator[Problem]:
    """Find a point that the profile has no function to read, or not with enough room."""
    size = size_of(table, area, width)
    if width > REGISTER and size > MOST_WIDE:
        yield error((*table.path, area), f"{size} registers of four bytes are too many for one request: {MOST_WIDE}")
    if profile is not None and table.write != "only":
        yield from _check_request((*table.path, area), profile, READERS[area][:1], size, "read")


def check_writing(
    table: PointTable, area: Area, addresses: Range, profile: ProfileTable | None, width: int
) -> Iterator[Problem]:
    """Find a point that cannot be written where or how it says."""
    if table.write == "no":
        for key in ("write_at", "write_function"):
            if getattr(table, key) is not None:
                yield error((*table.path, key), "the point is not written", "add write = true, or take it out")
        return
    if area not in WRITERS and table.write_at is None:
        remedy = "if it is written somewhere else, add write_at"
        yield error((*table.path, "write"), f"{ITEMS[area]} cannot be written", remedy)
        return
    if table.write_at is not None:
        yield from _check_other_place(table, area, addresses, profile, width)
    if bits_of(table, area) is not None:
        yield from _check_bits(table, area, profile, width)
    elif profile is not None:
        yield from _check_functions(table, area, profile, width)


def _check_other_place(
    table: PointTable, area: Area, addresses: Range, profile: ProfileTable | None, width: int
) -> Iterator[Problem]:
    first, last = addresses
    several = is_range(table, area, addresses, width)
    count = last - first + 1 if several else size_of(table, area, width)
    span = Span(Area.COILS if has_bits(area) else Area.HOLDING, table.write_at or 0, count)
    if span.end > MOST_ITEMS:
        what = f"the point would end at {span.end - 1}, and the last address is {MOST_ITEMS - 1}"
        yield error((*table.path, "write_at"), what)
        return
    yield from check_ranges((*table.path, "write_at"), span, profile)
    if profile is not None and not has_bits(area) and width_at(profile.wide, span) != width:
        yield error((*table.path, "write_at"), f"its registers have {width} bytes, and {span.addresses} have others")


def _check_bits(table: PointTable, area: Area, profile: ProfileTable | None, width: int) -> Iterator[Problem]:
    """Check what writes some bits of a register: function 22, or a read and a write."""
    first, last = bits_of(table, area) or (0, 0)
    key = next((key for key in ("bit", "bits", "byte") if getattr(table, key) is not None), "type")
    if area != Area.HOLDING or table.write_at is not None:
        remedy = "write the register as a point of its own"
        yield error((*table.path, key), "bits can be written only in the holding register in which they are", remedy)
    elif width > REGISTER or first // 16 != last // 16 or table.length is not None:
        yield error((*table.path, key), "can be written only in one register of two bytes", "take write out")
    elif table.min is not None or table.max is not None:
        yield from _check_guarded_bits(table, area, profile, width)
    elif profile is not None and (profile.functions is None or _MASK_WRITE not in profile.functions):
        if table.write == "only":
            remedy = f"add {int(_MASK_WRITE)} to the functions of the profile if the device has it"
            yield error((*table.path, "write"), "bits are written by reading the others, and it is never read", remedy)
        else:
            yield from _check_functions(table, area, profile, width)


def _check_guarded_bits(table: PointTable, area: Area, profile: ProfileTable | None, width: int) -> Iterator[Problem]:
    """Check what writes bits with limits: always a read and a write, for function 22 does not tell the value."""
    remedy = "take min and max out, or make the register a point with them"
    if table.write == "only":
        yield error((*table.path, "write"), "bits with limits are written by reading the others first", remedy)
    elif table.invalid and size_of(table, area, width) > 1:
        what = "numbers of several registers, and limits are for the one that is written"
        yield error((*table.path, "invalid"), what, "take it out, or min and max")
    elif profile is not None:
        yield from _check_functions(table, area, profile, width)


def _check_functions(table: PointTable, area: Area, profile: ProfileTable, width: int) -> Iterator[Problem]:
    single, several, _ = WRITERS[Area.COILS if has_bits(area) else Area.HOLDING]
    size = 1 if bits_of(table, area) is not None else size_of(table, area, width)
    key = "write_at" if table.write_at is not None else area
    how = table.write_function or profile.write_function
    if how == "single" and (size > 1 or width > REGISTER):
        what = f"function {int(single)} writes one register of two bytes, and the point is more"
        yield error((*table.path, "write_function" if table.write_function else key), what, 'write "multiple"')
        return
    if width > REGISTER:
        single = several
    functions = {"single": (single,), "multiple": (several,)}.get(how, (several,) if size > 1 else (single, several))
    yield from _check_request((*table.path, key), profile, functions, size, "written")


def _check_request(
    path: Path, profile: ProfileTable, functions: tuple[int, ...], size: int, done: str
) -> Iterator[Problem]:
    """Find out whether one of the `functions` can read or write a point of this `size`."""
    known = [each for each in functions if profile.functions is None or each in profile.functions]
    if not known:
        named = " or ".join(str(int(each)) for each in functions)
        what = f"cannot be {done}: function {named} is not among the functions of the profile"
        yield error(path, what, f"add {int(functions[0])} to functions, or take the point out")
    elif all(size > profile.limits.get(each, size) for each in known):
        most = max(profile.limits[each] for each in known)
        what = f"cannot be {done} at once: it takes {size}, and the profile allows {most} (function {int(known[0])})"
        yield error(path, what)
