"""Values of a virtual unit, one after the other: what each means, of which source it is, and how old."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from gateway.clock.times import optional_ms
from gateway.images.virtual.layout import Own
from gateway.images.virtual.row import Row, State
from gateway.images.virtual.settings import FreshBits, SourceAge
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.registers.items import has_bits, reference, unpack_bits, usual_type

_BITS_OF_REGISTER: Final = 16


@dataclass(frozen=True, slots=True)
class MapLine:
    """A value at the addresses of `point`, which has a name if the unit knows it by one.

    It is that of `there` at `device`: `power`, `holding 100`. `text` is empty while it is not known. Only values that
    are polled have a `state`.
    """

    point: Point
    text: str
    device: str = ""
    there: str = ""
    age_ms: float | None = None
    state: State | None = None

    @property
    def place(self) -> str:
        """Its addresses here: `holding 0-1`, `coils 3`, `holding 8.4-6`."""
        return f"{self.point.area} {self.point.span.addresses}{self.point.bits_shown}"

    @property
    def reference(self) -> str:
        """Its number in many manuals."""
        return reference(self.point.area, self.point.address) + self.point.bits_shown


def map_lines(unit: VirtualUnit, points: Sequence[Point], span: Span, now: float) -> Iterator[MapLine]:
    """List the values that begin at the addresses of `span`, in their order. `points` are those of the unit.

    Registers of its own are listed where they have points.
    """
    named: dict[int, list[Point]] = {}
    for point in points:
        if point.area is span.area and span.start <= point.address < span.end:
            named.setdefault(point.address, []).append(point)
    touched = unit.block.touched(span)
    for piece in sorted((*touched.rows, *touched.others), key=lambda each: each.place.start):
        within = Span(span.area, max(piece.place.start, span.start), 0)
        within = replace(within, count=min(piece.place.end, span.end) - within.start)
        if isinstance(piece, Row):
            yield from _of_row(unit, piece, named, within, now)
        elif isinstance(piece, FreshBits):
            yield from _of_bits(unit, piece, named, within, now)
        elif isinstance(piece, SourceAge):
            yield _line(unit, _one(named, Point("", span.area, piece.place.start, unit="s")), now, piece.device, "age")
        elif isinstance(piece, Own):
            for address in range(within.start, within.end):
                for point in named.get(address, ()):
                    yield _line(unit, point, now)


def place_there(row: Row, index: int = 0, count: int | None = None) -> str:
    """Name what the source calls a value: a point, or `count` addresses from this one of the row on."""
    point, first = row.mapped.point, row.poll.first
    if point is not None:
        return point.name
    if row.mapped.swap in ("words", "both") and count == 1:
        index ^= 1
    there = row.poll.span if count is None else Span(row.poll.area, first + index, count)
    return f"{there.area} {there.addresses}"


def _of_row(
    unit: VirtualUnit, row: Row, named: Mapping[int, Sequence[Point]], within: Span, now: float
) -> Iterator[MapLine]:
    """List the points in a row, and its registers that are in none. A value without a name here is one line."""
    state, age = row.state(now, unit.settings.stale), optional_ms(row.age(now))
    polled = MapLine(Point("", row.place.area, row.place.start), "", row.mapped.device, "", age, state)
    if row.mapped.point is not None and not named.get(row.place.start):
        if row.place.start >= within.start:
            yield _of_point(polled, row, row.mapped.point)
        return
    address = within.start
    while address < within.end:
        here = [point for point in named.get(address, ()) if point.span.end <= row.place.end]
        here = here or ([] if row.mapped.point is not None else [_item(row.place.area, address)])
        for point in here:
            there = place_there(row, address - row.place.start, point.count)
            text = _text(unit, point, now) if state in ("fresh", "stale") else ""
            yield replace(polled, point=point, text=text, there=there)
        address += max((point.count for point in here), default=1)


def _of_point(polled: MapLine, row: Row, point: Point) -> MapLine:
    here = replace(point, name="", area=row.place.area, address=row.place.start, count=row.place.count, bits=None)
    is_known = polled.state in ("fresh", "stale") and row.items is not None
    text = point.show(point.value(row.items)) if is_known and row.items is not None else ""
    return replace(polled, point=here, text=text, there=point.name)


def _of_bits(
    unit: VirtualUnit, bits: FreshBits, named: Mapping[int, Sequence[Point]], within: Span, now: float
) -> Iterator[MapLine]:
    for index, device in enumerate(bits.devices):
        if has_bits(within.area):
            point = _item(within.area, bits.place.start + index)
        else:
            register, bit = divmod(index, _BITS_OF_REGISTER)
            point = Point("", within.area, bits.place.start + register, bits=(bit, bit))
        if within.start <= point.address < within.end:
            yield _line(unit, _one(named, point), now, device, "fresh")


def _one(named: Mapping[int, Sequence[Point]], point: Point) -> Point:
    """Return the named point in the place of this one; itself if there is none."""
    return next((each for each in named.get(point.address, ()) if each.bits == point.bits), point)


def _line(unit: VirtualUnit, point: Point, now: float, device: str = "", there: str = "") -> MapLine:
    return MapLine(point, _text(unit, point, now), device, there)


def _item(area: Area, address: int) -> Point:
    return Point("", area, address, usual_type(area))


def _text(unit: VirtualUnit, point: Point, now: float) -> str:
    span = point.read_span
    data = unit.block.values(unit.block.touched(span), now)
    return point.show(point.value(unpack_bits(data, span.count) if has_bits(span.area) else data))
