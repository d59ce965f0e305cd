"""Cross-checks of points: impossible ones, and duplicate names."""

from collections.abc import Iterable, Iterator, Mapping

from gateway.config.checks.units import profile_of_row
from gateway.config.plan.areas import places_of
from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.points import is_range, names_of, size_of, type_of
from gateway.config.problem import Path, Problem, error
from gateway.config.schema.config import Config
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.values.ranges import MOST_ITEMS, show_ranges
from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range, covers
from gateway.registers.datatypes import bounds, is_whole
from gateway.registers.items import WRITERS, has_bits


def check_points(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find points that are not possible, and names that two points of a unit have. `failed` as in `check`."""
    for profile in config.profile.values():
        yield from _check_tables(profile.points, profile)
        yield from _check_names(profile.points, {})
    for owner in owners(config):
        for row in rows_of(owner):
            named = None if "profile" in failed else profile_of_row(config, owner, row)
            yield from _check_tables(row.points, named)
            yield from _check_names(row.points, _names(named.points) if named is not None and row.points else {})


def _check_tables(tables: Iterable[PointTable], profile: ProfileTable | None) -> Iterator[Problem]:
    for table in tables:
        if len(places_of(table)) != 1:
            what = "must have one of holding, input, coils and discrete"
            yield error(table.path, what, "such as holding = 16; addresses count from 0: 40017 is 16")
            continue
        ((area, addresses),) = places_of(table)
        wrong_type = [*_check_type(table, area)]
        yield from wrong_type
        if not wrong_type:
            yield from _check_place(table, area, addresses, profile)
            yield from _check_requests(table, area, profile)
        yield from _check_number(table, area)


def _check_type(table: PointTable, area: Area) -> Iterator[Problem]:
    path, data_type = table.path, type_of(table, area)
    if has_bits(area) != (data_type == "bit"):
        what = f"{_items(area)} are {'bits' if has_bits(area) else 'no bits'}"
        remedy = "leave type out" if has_bits(area) else "read the whole register, and name its numbers with labels"
        yield error((*path, "type"), what, remedy)
    elif data_type == "string" and table.length is None:
        yield error((*path, "type"), "a string needs its length", "add length = 8: the number of its registers")
    elif data_type != "string" and table.length is not None:
        yield error((*path, "length"), f"only a string has a length; {data_type} has its own", "take it out")
    elif table.swap in _useless_swaps(table, area):
        yield error(
            (*path, "swap"), f"there is nothing to swap: the point is one {'bit' if has_bits(area) else 'word'}"
        )


def _useless_swaps(table: PointTable, area: Area) -> tuple[str, ...]:
    if has_bits(area):
        return ("words", "bytes", "both")
    return ("words", "both") if size_of(table, area) == 1 else ()


def _check_place(table: PointTable, area: Area, addresses: Range, profile: ProfileTable | None) -> Iterator[Problem]:
    first, last = addresses
    size, several = size_of(table, area), is_range(table, area, addresses)
    path, end = (*table.path, area), last if several else first + size - 1
    exist: tuple[Range, ...] | None = None if profile is None else getattr(profile, area)
    if end >= MOST_ITEMS:
        yield error(path, f"the point ends at {end}, and the last address is {MOST_ITEMS - 1}")
    elif several and (last - first + 1) % size:
        whole = first + (last - first + 1) // size * size - 1
        remedy = f'write "{first}-{whole if whole > first else first + size - 1}"'
        yield error(path, f"{last - first + 1} registers are no whole number of values of {size}", remedy)
    elif not covers(exist, Span(area, first, end - first + 1)):
        yield error(path, f"the profile has no {area} {first}-{end}, but {show_ranges(exist or ())}")
    if several != ("*" in table.name):
        what = "several points need several names" if several else "* stands for a number, and this is one point"
        yield error((*table.path, "name"), what, f'write "{table.name}-*"' if several else "take it out")
    if table.first is not None and not several:
        yield error((*table.path, "first"), "only a range of points has it", "take it out")


def _check_requests(table: PointTable, area: Area, profile: ProfileTable | None) -> Iterator[Problem]:
    """Find points that the profile has no function to read or write, or none with enough room."""
    path, size = (*table.path, area), size_of(table, area)
    if profile is not None and table.write != "only":
        yield from _check_request(path, profile, READERS[area][:1], size, "read")
    if table.write == "no":
        return
    if area not in WRITERS:
        yield error((*table.path, "write"), f"{_items(area)} cannot be written")
    elif profile is not None:
        single, several, _ = WRITERS[area]
        yield from _check_request(path, profile, (several,) if size > 1 else (single, several), size, "written")


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


def _check_number(table: PointTable, area: Area) -> Iterator[Problem]:
    """Find scale and decimals at what is no number, and labels at what is no whole one."""
    data_type = type_of(table, area)
    if table.scale == 0:
        yield error((*table.path, "scale"), "must not be 0")
    for key in ("scale", "decimals"):
        if table.has(key) and data_type in ("bit", "string"):
            yield error((*table.path, key), f"a {data_type} is no number to be scaled or rounded", "take it out")
    if table.labels and not is_whole(data_type):
        yield error((*table.path, "labels"), f"labels are for whole numbers, and a {data_type} is none")
    elif table.labels:
        least, greatest = bounds(data_type)
        strange = next((number for number in table.labels if not least <= number <= greatest), None)
        if strange is not None:
            what = f"{strange} does not fit into {data_type}: {least} to {greatest}"
            yield error((*table.path, "labels"), what)


def _check_names(tables: Iterable[PointTable], taken: Mapping[str, str]) -> Iterator[Problem]:
    names = dict(taken)
    for table in tables:
        own = _names((table,))
        twice = next((name for name in own if name in names), None)
        if twice is not None:
            yield error((*table.path, "name"), f'the point "{twice}" is already there: {names[twice]}')
        names |= own


def _names(tables: Iterable[PointTable]) -> dict[str, str]:
    """Collect the names of points, each with its source."""
    return {
        name: source
        for table in tables
        for source in (table.place or "a built-in profile",)
        for area, addresses in places_of(table)
        for name in names_of(table, area, addresses)
    }


def _items(area: Area) -> str:
    return {"coils": "coils", "discrete": "discrete inputs", "input": "input registers"}.get(area, "holding registers")
