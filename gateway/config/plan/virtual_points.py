"""The points of a virtual unit: those of its profile, or else those of its rows, named after device and point."""

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from gateway.config.plan.map_place import MapSource
from gateway.config.plan.unit_points import points_in
from gateway.config.values.names import LONGEST_NAME
from gateway.images.virtual.settings import FreshBits, MappedValue, VirtualSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import covers
from gateway.registers.items import REGISTER, has_bits

#: What the name of a point cannot have, and what it cannot begin with.
_NO_PART: Final = re.compile(r"[^\w.-]+")
_NO_BEGINNING: Final = re.compile(r"^[\W\d_]+")
#: Scale registers are read together with their points.
_MOST_AT_ONCE: Final = 125


def points_of_profile(unit: VirtualSettings, points: Iterable[Point]) -> tuple[Point, ...]:
    """Choose the points of its profile that a unit has. Its rows say which of them can be written, not the profile."""
    return tuple(
        point
        if covers(unit.own.areas.get(point.area, ()), point.span)
        else replace(point, write="yes" if _is_written(point, unit.values) else "no", write_at=None)
        for point in points_in(unit.areas, points)
    )


def _is_written(point: Point, values: Iterable[MappedValue]) -> bool:
    """Tell whether a row takes writes of a point: one of just this value, or one of registers as they are."""
    for value in values:
        place = value.place
        if value.write and place.area is point.area and covers(((place.start, place.end - 1),), point.span):
            return value.point is None or (place == point.span and point.bits is None)
    return False


def points_of_rows(unit: VirtualSettings, sources: Mapping[str, MapSource]) -> tuple[Point, ...]:
    """Make the points of the rows of a unit, in their order: `meter-1.power`, `meter-1.fresh` and `meter-1.age`.

    Names that two of them would have get numbers behind them, from 2 on.
    """
    layouts = {name: _Layout(sources[name].points.values()) for name in unit.devices}
    places = _Places(unit.values)
    names = _Names()
    of_values = (
        (value.device, point)
        for value in unit.values
        for point in _points(value, sources[value.device], layouts[value.device], places)
    )
    of_bits = (each for bits in unit.fresh for each in _bits(bits))
    of_ages = ((age.device, Point("age", age.place.area, age.place.start, unit="s")) for age in unit.ages)
    named = (*of_values, *of_bits, *of_ages)
    return tuple(replace(point, name=names.unique(_name(device, point.name))) for device, point in named)


class _Layout:
    """The points of a device by area, in the order of their addresses."""

    def __init__(self, points: Iterable[Point]) -> None:
        self._points: dict[Area, list[Point]] = {}
        for point in sorted(points, key=lambda each: each.address):
            self._points.setdefault(point.area, []).append(point)

    def within(self, span: Span) -> Iterator[Point]:
        """Yield the points that are wholly in a span."""
        points = self._points.get(span.area, [])
        for point in points[bisect_left(points, span.start, key=lambda each: each.address) :]:
            if point.address >= span.end:
                break
            if point.span.end <= span.end and point.write != "only" and point.width == REGISTER:
                yield point


class _Places:
    """Where registers of devices are in a unit, as they are."""

    def __init__(self, values: Iterable[MappedValue]) -> None:
        self._found: dict[tuple[str, Area, int], Span] = {}
        for value in values:
            if value.target is None and value.swap == "none" and value.poll.width == REGISTER:
                there = value.poll.span if value.point is None else value.point.span
                for index in range(there.count):
                    here = Span(value.place.area, value.place.start + index, 1)
                    self._found.setdefault((value.device, there.area, there.start + index), here)

    def of_scale(self, device: str, point: Point, place: Span) -> int | None:
        """Find where the scale register of a point is, if it is near its place in the unit; None if it is not."""
        found = self._found.get((device, point.area, -1 if point.scale_at is None else point.scale_at))
        if found is None or found.area is not place.area:
            return None
        return found.start if place.up_to(found.start).count <= _MOST_AT_ONCE else None


def _points(value: MappedValue, source: MapSource, layout: _Layout, places: _Places) -> Iterator[Point]:
    """Make the points of a row: that of a point, or those within a range that is as the device has it."""
    if value.target is not None and value.point is not None:
        of_device = source.points[value.point.name]
        is_number_alike = (value.target.scale, value.target.offset) == (of_device.scale, of_device.offset)
        yield replace(value.target, labels=of_device.labels if is_number_alike and of_device.scale_at is None else {})
    elif value.point is not None:
        yield from _moved(source.points[value.point.name], value, value.place, places)
    elif value.swap == "none":
        for point in layout.within(value.poll.span):
            start = value.place.start + point.address - value.poll.first
            yield from _moved(point, value, Span(value.place.area, start, point.count), places)


def _bits(bits: FreshBits) -> Iterator[tuple[str, Point]]:
    """Make the points of the freshness of devices."""
    area, start = bits.place.area, bits.place.start
    for index, device in enumerate(bits.devices):
        if has_bits(area):
            yield device, Point("fresh", area, start + index, "bit")
        else:
            register, bit = divmod(index, 16)
            yield device, Point("fresh", area, start + register, bits=(bit, bit))


def _moved(point: Point, value: MappedValue, place: Span, places: _Places) -> Iterator[Point]:
    """Make the point at its place in the unit; none if its scale register is not there, too."""
    scale_at = None
    if point.scale_at is not None:
        scale_at = places.of_scale(value.device, point, place)
        if scale_at is None:
            return
    is_writable = value.write and point.write != "no" and (value.point is not None or point.write_at is None)
    yield replace(
        point,
        area=place.area,
        address=place.start,
        count=place.count,
        width=REGISTER,
        scale_at=scale_at,
        write="yes" if is_writable else "no",
        write_at=None,
        write_function="auto",
        bits=None if has_bits(place.area) else point.bits,
    )


def _name(device: str, point: str) -> str:
    """Make the name of a point from those of a device and its point."""
    name = _NO_BEGINNING.sub("", _NO_PART.sub("-", f"{device}.{point}"))
    return name if len(name) <= LONGEST_NAME else name[-LONGEST_NAME:].lstrip("-_.0123456789")


class _Names:
    """Makes names unique."""

    def __init__(self) -> None:
        self._next: dict[str, int] = {}

    def unique(self, name: str) -> str:
        """Return the name, with a number behind it if it is taken."""
        found = name
        while found in self._next:
            number = self._next[name] = self._next[name] + 1
            ending = f"-{number}"
            found = name[: LONGEST_NAME - len(ending)] + ending
        self._next[found] = 1
        return found
