"""What the rows of a virtual unit map: each row turned into values, bits and ages, or into what is wrong with it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from gateway.config.plan.map_conversion import as_written, registers_as_they_are
from gateway.config.plan.map_place import MapSource, MapTarget, RowPlace, WrongRow, cannot_be_polled
from gateway.config.problem import Problem, did_you_mean, error
from gateway.config.schema.image import Mapped
from gateway.images.polls import Poll
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.read_rules import ReadRules
from gateway.profiles.writing import to_be_writable
from gateway.registers.items import REGISTER, WRITERS, has_bits

#: What a row becomes: one of these, or several values.
MapPart = MappedValue | FreshBits | SourceAge

#: Stands for all points of a device.
EVERY_POINT: Final = "*"
_BITS_OF_REGISTER: Final = 16


class PlannedRow(NamedTuple):
    """A row of the config with its parts, in the order of their addresses; or with what is wrong with it."""

    row: Mapped
    parts: tuple[MapPart, ...]
    wrong: Problem | None = None


def planned_rows(target: MapTarget, sources: Mapping[str, MapSource]) -> Iterator[PlannedRow]:
    """Plan each row of a virtual unit. All rows have the keys of one kind of row, and name sources."""
    for row in target.image.map:
        try:
            yield PlannedRow(row, tuple(_parts(row, target, sources)))
        except WrongRow as wrong:
            yield PlannedRow(row, (), error((*row.path, wrong.key), str(wrong), wrong.remedy))


def _parts(row: Mapped, target: MapTarget, sources: Mapping[str, MapSource]) -> Iterator[MapPart]:
    place = target.place_of(row)
    if row.fresh:
        count = len(row.fresh) if has_bits(place.area) else -(-len(row.fresh) // _BITS_OF_REGISTER)
        place.check_size(count, "fresh")
        yield FreshBits(target.span(place.area, place.start, count), row.fresh)
    elif row.age is not None:
        if has_bits(place.area):
            raise WrongRow("age", f"{place.area} are single bits, and an age is a register", "map it in another area")
        place.check_size(1, "age")
        yield SourceAge(target.span(place.area, place.start, 1), row.age)
    elif row.device is not None:
        values = _Values(row, target, sources[row.device])
        if row.point == EVERY_POINT:
            yield from values.of_every_point(place)
        elif row.point is not None:
            yield values.of_point(values.named(row.point), place)
        else:
            yield values.of_range(place)


@dataclass(frozen=True, slots=True)
class _Values:
    """What a row takes of its source."""

    row: Mapped
    target: MapTarget
    source: MapSource

    def named(self, name: str) -> Point:
        """Find a point of the source."""
        point = self.source.points.get(name)
        if point is None:
            remedy = did_you_mean(name, self.source.points)
            if not self.source.points:
                remedy = 'it has no points: name addresses, such as holding = "0-1", or give points to its profile'
            raise WrongRow("point", f'{self.source.name} has no point "{name}"', remedy)
        if point.write == "only":
            raise WrongRow("point", f"{name} of {self.source.name} is only written, and has no value")
        return point

    def of_range(self, place: RowPlace) -> MappedValue:
        """Plan a range of addresses, as they are."""
        area, (first, last) = next((each, getattr(self.row, each)) for each in Area if self.row.has(each))
        there, here = Span(area, first, last - first + 1), place.area
        if has_bits(area) != has_bits(here):
            have, are = ("bits", "registers") if has_bits(area) else ("registers", "bits")
            raise WrongRow(area, f"these are {have}, and {here} of this unit are {are}", "map them in another area")
        poll = self._poll(there, REGISTER, area)
        if self.source.profile.has_wide(there):
            what = f"registers of {self.source.name} with four bytes are mapped only as points"
            raise WrongRow(area, what, "map each by its point")
        place.check_size(there.count, area)
        self._check_swap(there)
        if self.row.write:
            self._check_written(there, here)
        return self._value(self.target.span(here, place.start, there.count), poll, swap=self.row.swap or "none")

    def of_point(self, point: Point, place: RowPlace) -> MappedValue:
        """Plan a point: with its registers as they are, or converted."""
        poll = self._poll(point.read_span, point.width, "point")
        if self.row.write and point.write == "no":
            what = f"{point.name} of {self.source.name} cannot be written"
            remedy = f"take it out, or add {to_be_writable(point)} to the point"
            if self.row.point == EVERY_POINT:
                remedy = "take it out, and map the points that can be written by their names"
            raise WrongRow("write", what, remedy)
        written = as_written(self.row, point, place, self.target)
        count = registers_as_they_are(point) if written is None else written.count
        if self.row.write:
            self._check_written(point.write_span, place.area, count)
        # The values are numbers here: no register has a label.
        return self._value(self.target.span(place.area, place.start, count), poll, replace(point, labels={}), written)

    def of_every_point(self, place: RowPlace) -> Iterator[MappedValue]:
        """Plan all points of registers, or of coils and discrete inputs, one behind the other from the place on."""
        order = (Area.COILS, Area.DISCRETE) if has_bits(place.area) else (Area.HOLDING, Area.INPUT)
        points = [each for each in self.source.points.values() if each.area in order and each.write != "only"]
        if not points:
            kinds = f"{Area.COILS} or {Area.DISCRETE} inputs" if has_bits(place.area) else "registers"
            raise WrongRow("point", f"{self.source.name} has no points of {kinds}")
        for point in sorted(points, key=lambda each: (order.index(each.area), each.address)):
            value = self.of_point(point, place)
            yield value
            place = RowPlace(place.area, value.place.end)

    def _value(
        self, place: Span, poll: Poll, point: Point | None = None, target: Point | None = None, swap: str = "none"
    ) -> MappedValue:
        row = self.row
        when_stale = self.target.image.when_stale if row.when_stale is None else row.when_stale
        return MappedValue(place, self.source.name, poll, point, target, swap, row.write, when_stale, row.place)

    def _poll(self, span: Span, width: int, key: str) -> Poll:
        source = self.source
        exist = source.areas.get(span.area)
        for what, remedy in cannot_be_polled(source.name, source.profile.functions, exist, span):
            raise WrongRow(key, what, remedy)
        most = ReadRules.of(source.profile).most(span.area, width)
        if span.count > most:
            what = f"one request reads a row, and {source.name} answers {most} of {span.area} at once, not {span.count}"
            raise WrongRow(key, what, "make several rows of it")
        return Poll(span.area, span.start, span.end - 1, self.row.every or 0.0, width=width)

    def _check_swap(self, span: Span) -> None:
        swap = self.row.swap
        if swap is None or swap == "none":
            return
        if has_bits(span.area):
            raise WrongRow("swap", f"{span.area} have no order of words and bytes", "take it out")
        if span.count % 2:
            raise WrongRow("swap", f"it turns pairs of registers, and {span.count} are no pairs")
        if self.row.write:
            what = "a range whose registers are turned takes no writes"
            raise WrongRow("write", what, "take it out, or map each value by its point, with type and swap")

    def _check_written(self, there: Span, here: Area, at_once: int = 1) -> None:
        """Check that writes of so many items to an area here can go to these addresses there."""
        if here not in WRITERS:
            raise WrongRow("write", f"{here} of this unit cannot be written", "take it out, or map it in another area")
        if there.area not in WRITERS:
            raise WrongRow("write", f"{there.area} of {self.source.name} cannot be written", "take it out")
        of_unit = f"profile {self.target.profile.name}"
        for name, profile, area in (
            (self.source.name, self.source.profile, there.area),
            (of_unit, self.target.profile, here),
        ):
            single, several, _ = WRITERS[area]
            if not (profile.knows(single) or profile.knows(several)):
                what = f"{name} has no function {single:d} or {several:d}, which write {area}"
                raise WrongRow("write", what, "take it out")
        _, several, most = WRITERS[here]
        most = self.target.profile.limits.get(several, most) if self.target.profile.knows(several) else 1
        if at_once > most:
            what = f"{at_once} of {here} are one value, and one write to {of_unit} sets {most}"
            raise WrongRow("write", what, "take it out, or choose a shorter type")
