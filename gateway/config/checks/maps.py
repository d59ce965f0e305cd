"""Cross-checks of the maps of virtual units: rows, where they stand, and what their devices allow."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from gateway.config.plan.map_place import MapTarget
from gateway.config.plan.map_rows import EVERY_POINT, MapPart, PlannedRow
from gateway.config.plan.points import ranges_in
from gateway.config.plan.virtual import Maps
from gateway.config.problem import Path, Problem, did_you_mean, error, listed, warning
from gateway.config.schema.image import Image, Mapped
from gateway.config.values.duration import show_duration
from gateway.images.virtual.settings import MappedValue
from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.registers.datatypes import BYTE_TYPES
from gateway.registers.items import has_bits

#: So many gaps are told.
_MOST_TOLD: Final = 3
#: The keys that say what a row has, and those that only some rows have.
_SOURCES: Final = ("point", *Area)
_OF_VALUES: Final = ("point", *Area, "every", "type", "swap", "scale", "offset", "write", "when_stale")
_OF_CONVERSION: Final = ("type", "scale", "offset")
_EXAMPLE: Final = 'such as { at = 0, device = "meter-1", point = "power", every = "1 s" }'


def check_map(image: Image) -> Iterator[Problem]:
    """Find what is wrong with the rows of a virtual unit by themselves, and with their names of each other."""
    if image.has("read"):
        yield error(
            (*image.path, "read"), "only a mirror has this key", "take it out: rows of the map say what is read"
        )
    if not image.map:
        remedy = 'write map = [{ at = 0, device = "meter-1", point = "power", every = "1 s" }]'
        yield error((*image.path, "map"), "is empty", remedy)
    for row in image.map:
        yield from check_row(row)
    yield from _check_names(image)
    yield from _check_fresh(image)
    yield from _check_every(image)


def check_planned_maps(maps: Maps) -> Iterator[Problem]:
    """Find rows that their device, or the profile of their unit, does not allow, and rows that overlap.

    The config has passed all other checks of its tables.
    """
    for target, planned in zip(maps.targets, maps.rows, strict=True):
        yield from (row.wrong for row in planned if row.wrong is not None)
        yield from _check_numbers(target.image, planned)
        yield from _check_scales(planned)
        yield from _check_units_of_measure(planned)
        placed = _placed(target, planned)
        for area in Area:
            yield from _check_overlaps(placed[area])
            if all(row.wrong is None for row in planned):
                yield from _check_gaps(target.image, area, placed[area])


def _check_names(image: Image) -> Iterator[Problem]:
    """Find devices whose freshness or age is asked for, and that no row reads."""
    known = dict.fromkeys(row.device for row in image.map if row.device is not None)
    for row in image.map:
        named = [((*row.path, "fresh", index), name) for index, name in enumerate(row.fresh)]
        if row.age is not None:
            named.append(((*row.path, "age"), row.age))
        for path, name in named:
            if name not in known:
                yield error(path, f'no row of this map reads "{name}"', did_you_mean(name, known))


def _check_fresh(image: Image) -> Iterator[Problem]:
    """Find devices of which a client cannot tell that their values are stale."""
    told = {name for row in image.map for name in row.fresh}
    unit: dict[str, None] = {}
    for row in image.map:
        when_stale = image.when_stale if row.when_stale is None else row.when_stale
        if row.device is None or row.device in told or when_stale == "exception":
            continue
        if row.when_stale is None:
            unit[row.device] = None
        else:
            yield _without_bit((*row.path, "when_stale"), [row.device])
    if unit:
        yield _without_bit((*image.path, "when_stale"), list(unit))


def _without_bit(path: Path, devices: list[str]) -> Problem:
    what = f"clients could not tell that values of {listed(devices)} are stale"
    return error(path, what, f'add a row with a bit for it: {{ at = ADDRESS, fresh = ["{devices[0]}"] }}')


def _check_every(image: Image) -> Iterator[Problem]:
    late = [row for row in image.map if row.every is not None and row.every >= image.stale]
    if late:
        others = len(late) - 1
        more = f" (and so in {others} more row{'' if others == 1 else 's'})" if others else ""
        what = f"values become stale between two polls{more}: stale is {show_duration(image.stale)}"
        yield warning((*late[0].path, "every"), what, "make stale two or three times as long as every")


def _check_numbers(image: Image, planned: Iterable[PlannedRow]) -> Iterator[Problem]:
    """Find numbers for stale values that a coil cannot have."""
    rows = [
        (row, part.place.area)
        for row, parts, _ in planned
        for part in parts[:1]
        if isinstance(part, MappedValue) and has_bits(part.place.area)
        if isinstance(part.when_stale, int) and part.when_stale > 1
    ]
    yield from (
        error((*row.path, "when_stale"), f"{area} can only be 0 or 1")
        for row, area in rows
        if row.when_stale is not None
    )
    area = next((area for row, area in rows if row.when_stale is None), None)
    if area is not None:
        what = f"this map has {area}, which can only be 0 or 1"
        yield error((*image.path, "when_stale"), what, "write when_stale in the rows")


def _check_scales(planned: Iterable[PlannedRow]) -> Iterator[Problem]:
    """Warn of points that are mapped as they are, and whose scale is in a register that is not mapped so."""
    values = [(row, part) for row, parts, _ in planned for part in parts if isinstance(part, MappedValue)]
    plain = [
        (row, value, value.point)
        for row, value in values
        if value.target is None and value.point is not None and value.point.scale_at is not None
    ]
    as_they_are = {
        (value.device, value.poll.area, address)
        for _, value in (values if plain else ())
        if value.target is None and value.swap == "none"
        for span in (value.poll.span if value.point is None else value.point.span,)
        for address in range(span.start, span.end)
    }
    for row, value, point in plain:
        if (value.device, point.area, point.scale_at) not in as_they_are:
            what = f"{point.name} has its scale in {point.area} {point.scale_at} there, and that is not mapped"
            yield warning((*row.path, "point"), what, 'write type, such as "float32": then the value is scaled')


def _check_units_of_measure(planned: Iterable[PlannedRow]) -> Iterator[Problem]:
    """Warn of points of the profile whose values are in another unit of measure than those that they are made of."""
    for row, parts, _ in planned:
        for value in parts if isinstance(row.at, str) else ():
            if not isinstance(value, MappedValue) or value.point is None or value.target is None:
                continue
            there, here = value.point.unit, value.target.unit
            if there and here and there != here:
                what = f"{value.point.name} of {value.device} is in {there}, and {value.target.name} here in {here}"
                remedy = f"numbers are copied as they are: give {value.device} a point with another scale, in {here}"
                yield warning((*row.path, "point"), what, remedy)


class _Placed(NamedTuple):
    """Addresses of a unit, and the row that has them; None for registers of its own."""

    span: Span
    row: Mapped | None
    number: int


def _placed(target: MapTarget, planned: Sequence[PlannedRow]) -> dict[Area, list[_Placed]]:
    """List what each area of a unit has, in the order of the addresses; what is wider stands first."""
    found: dict[Area, list[_Placed]] = {area: [] for area in Area}
    for area in Area:
        for first, last in ranges_in(area, target.image):
            found[area].append(_Placed(Span(area, first, last + 1 - first), None, -1))
    for number, (row, parts, _) in enumerate(planned):
        for span in _runs(parts):
            found[span.area].append(_Placed(span, row, number))
    for placed in found.values():
        placed.sort(key=lambda each: (each.span.start, -each.span.count))
    return found


def _runs(parts: Sequence[MapPart]) -> Iterator[Span]:
    """Give the addresses of a row: its parts stand one behind the other."""
    if parts:
        first, last = parts[0].place, parts[-1].place
        yield Span(first.area, first.start, last.end - first.start)


def _check_overlaps(placed: Sequence[_Placed]) -> Iterator[Problem]:
    """Find rows with addresses of another one, or of the unit's own registers: one error for each, at the later row."""
    farthest: _Placed | None = None
    told = set[int]()
    for each in placed:
        if farthest is not None and each.span.start < farthest.span.end:
            later, earlier = (each, farthest) if each.number > farthest.number else (farthest, each)
            if later.row is not None and later.number not in told:
                told.add(later.number)
                yield _overlap(later.row, later.span, earlier)
        if farthest is None or each.span.end > farthest.span.end:
            farthest = each


def _overlap(row: Mapped, span: Span, earlier: _Placed) -> Problem:
    start, end = max(span.start, earlier.span.start), min(span.end, earlier.span.end)
    both = Span(span.area, start, end - start)
    if earlier.row is None:
        what = f"{both.area} {both.addresses}: registers of the unit's own, which no row may have"
        return error((*row.path, "at"), what, f"choose another address, or take them out of {both.area}")
    what = f"{both.area} {both.addresses}: the row at {earlier.row.place} has them already"
    return error((*row.path, "at"), what, f"{earlier.span.end} is the first address behind that row")


def _check_gaps(image: Image, area: Area, placed: Sequence[_Placed]) -> Iterator[Problem]:
    """Warn of addresses that nothing has, beside rows that one request could read together."""
    most, gaps, at = READERS[area][1], list[Span](), list[Mapped]()
    for before, each in pairwise(_farthest(placed)):
        gap = Span(area, before.span.end, each.span.start - before.span.end)
        row = each.row or before.row
        if 0 < gap.count <= most - 2 and row is not None:
            gaps.append(gap)
            at.append(row)
    if gaps:
        told = ", ".join(gap.addresses for gap in gaps[:_MOST_TOLD])
        others = len(gaps) - _MOST_TOLD
        more = f" and {others} more gap{'' if others == 1 else 's'}" if others > 0 else ""
        what = f"nothing is at {area} {told}{more}: a read over it is answered 02"
        filling = ", ".join(f'"{gap.start}-{gap.end - 1}"' for gap in gaps[:_MOST_TOLD])
        listed = filling if len(gaps) == 1 else f"[{filling}]"
        own = f"add {filling} to {area}" if ranges_in(area, image) else f"{area} = {listed}"
        remedy = f"close it, or let it have registers of the unit's own, which are 0: {own}"
        yield warning((*at[0].path, "at"), what, remedy)


def _farthest(placed: Sequence[_Placed]) -> Iterator[_Placed]:
    """Leave out what is wholly within earlier addresses."""
    end = -1
    for each in placed:
        if each.span.end > end:
            end = each.span.end
            yield each


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
