"""The registers of a unit: what stands at each address, and which of its points it is."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from gateway.cli.show.virtual import MappedLine, mapped_lines
from gateway.config.plan.settings import Plan
from gateway.config.values.unitset import show_unit
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Range
from gateway.registers.items import WRITERS


@dataclass(frozen=True, slots=True)
class MapRow:
    """Some addresses of a unit: what stands there, and the point of the unit that it is, if it is one."""

    line: MappedLine
    point: Point | None = None


@dataclass(frozen=True, slots=True)
class RegisterMap:
    """All that a unit has that is known; `unit` is its number for clients, as text."""

    unit: str
    name: str
    rows: tuple[MapRow, ...]


def units_with_maps(plan: Plan) -> dict[str, int | None]:
    """List the names of all units that may have a map, with their numbers for clients."""
    known = {device.name: device.client_unit for device in plan.shared}
    known |= {image.name: image.unit for image in plan.images}
    known |= {mirror.name: mirror.unit for mirror in plan.mirrors}
    return known | {unit.name: unit.unit for unit in plan.virtual}


def register_map(plan: Plan, name: str) -> RegisterMap:
    """Make the map of the unit with this name; it has no rows if nothing is known of a device's registers."""
    for unit in plan.virtual:
        if unit.name == name:
            lines = [line for line in mapped_lines(unit) if line.what != "gap"]
            return _map(plan, unit.unit, name, lines)
    for mirror in plan.mirrors:
        if mirror.name == name:
            return _map(plan, mirror.unit, name, _mirrored(mirror))
    for image in plan.images:
        if image.name == name:
            return _map(plan, image.unit, name, _of_image(image))
    device = next(device for device in plan.shared if device.name == name)
    points = _in_order(plan.points.get(device.known_as, ()))
    return RegisterMap(
        show_unit(device.client_unit), name, tuple(MapRow(_of_device(name, each), each) for each in points)
    )


def _map(plan: Plan, unit: int, name: str, lines: Iterable[MappedLine]) -> RegisterMap:
    points = [point for point in _in_order(plan.points.get(unit, ())) if point.write != "only"]
    return RegisterMap(str(unit), name, tuple(_by_points(lines, points)))


def _in_order(points: Iterable[Point]) -> list[Point]:
    order = list(Area)
    return sorted(points, key=lambda point: (order.index(point.area), point.address, point.bits or (0, 0)))


def _by_points(lines: Iterable[MappedLine], points: list[Point]) -> Iterator[MapRow]:
    """Split lines into the points of the unit, and what is between them. Both are in the order of areas and addresses.

    A point that is not wholly in a line is not shown.
    """
    order, number = list(Area), 0

    def place(span: Span) -> tuple[int, int]:
        return order.index(span.area), span.start

    for line in lines:
        while number < len(points) and place(points[number].span) < place(line.place):
            number += 1
        start = line.place.start
        while number < len(points) and place(points[number].span) < (order.index(line.place.area), line.place.end):
            point = points[number]
            number += 1
            if point.span.end > line.place.end:
                continue
            if point.address > start:
                yield MapRow(_part(line, start, point.address))
            yield MapRow(_of_point(line, point), point)
            start = max(start, point.span.end)
        if start < line.place.end:
            yield MapRow(_part(line, start, line.place.end))


def _part(line: MappedLine, start: int, end: int) -> MappedLine:
    """Make a part of a line. Only ranges and registers of the unit's own are divided."""
    shift, place = start - line.place.start, Span(line.place.area, start, end - start)
    there = line.there
    if there is not None and there.count == line.place.count:
        there = Span(there.area, there.start + shift, place.count)
    return replace(line, place=place, there=there)


def _of_point(line: MappedLine, point: Point) -> MappedLine:
    """Say of the part of a line that is a point of the unit what the point says."""
    device = point.name.removesuffix(".fresh") if line.what == "fresh" else line.device
    return replace(
        _part(line, point.address, point.span.end),
        device=device,
        type="bit" if point.is_bit else point.type,
        swap="" if point.swap == "none" else point.swap,
        scale=point.scale,
        offset=point.offset,
        scale_at=_scale_at(point),
        unit=point.unit,
        write=line.write if line.what == "own" else line.write and point.write != "no",
    )


def _of_image(image: ImageSettings) -> Iterator[MappedLine]:
    for span in _spans(image.areas):
        yield MappedLine(span, "own", write=_takes_writes(span) and not image.shows_gateway)


def _mirrored(mirror: MirrorSettings) -> Iterator[MappedLine]:
    order, takes_writes = list(Area), mirror.together is None  # nothing is written to a device that is only heard
    for poll in sorted(mirror.polls, key=lambda each: (order.index(each.area), each.first)):
        yield MappedLine(
            poll.span, "value", mirror.of, poll.span, every=poll.every, write=takes_writes and _takes_writes(poll.span)
        )


def _of_device(name: str, point: Point) -> MappedLine:
    return MappedLine(
        point.write_span if point.write == "only" else point.span,
        "value",
        name,
        type="bit" if point.is_bit else point.type,
        swap="" if point.swap == "none" else point.swap,
        scale=point.scale,
        offset=point.offset,
        scale_at=_scale_at(point),
        unit=point.unit,
        write=point.write != "no",
    )


def _scale_at(point: Point) -> str:
    return "" if point.scale_at is None else f"{point.area} {point.scale_at}"


def _spans(areas: Mapping[Area, tuple[Range, ...]]) -> list[Span]:
    return [Span(area, first, last + 1 - first) for area in Area for first, last in areas.get(area, ())]


def _takes_writes(span: Span) -> bool:
    return span.area in WRITERS
