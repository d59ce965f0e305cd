"""Groups points into as few requests as the device allows."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes, holes_between, middle_hole
from gateway.profiles.point import Point
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import items_read, read_request


class Batch(NamedTuple):
    """Points that one request reads, all of them in `span`, in the order of their addresses."""

    span: Span
    points: tuple[Point, ...]

    @property
    def request(self) -> bytes:
        """The request PDU that reads them."""
        return read_request(self.span)

    def items_read(self, response: bytes) -> Iterator[tuple[Point, bytes]]:
        """Yield each point with the items of its `read_span` in a normal response.

        Raises:
            ValueError: the response is too short.
        """
        items = items_read(self.span, response, self.points[0].width)
        size = len(items) // self.span.count
        for point in self.points:
            span = point.read_span
            start = (span.start - self.span.start) * size
            yield point, items[start : start + span.count * size]

    @property
    def bridged(self) -> int:
        """The number of addresses that are read though no point has them."""
        return sum(hole.count for hole in holes_between(point.read_span for point in self.points))

    @property
    def hole(self) -> Span | None:
        """The hole at which it is split when it is refused; None if it has none."""
        return middle_hole(point.read_span for point in self.points)

    @property
    def parts(self) -> "tuple[Batch, ...]":
        """What to read instead when it is refused: its two sides of the hole, or its points; nothing for one point."""
        hole = self.hole
        if hole is None:
            return tuple(_batch((point,)) for point in self.points) if len(self.points) > 1 else ()
        before = tuple(point for point in self.points if point.read_span.start < hole.start)
        return _batch(before), _batch(self.points[len(before) :])


def batches(points: Iterable[Point], rules: ReadRules, holes: Holes) -> list[Batch]:
    """Group points by area and address, as the device allows it; `holes` are those that it has refused."""
    return list(batches_of(points, rules, holes))


def batches_of(points: Iterable[Point], rules: ReadRules, holes: Holes) -> Iterator[Batch]:
    """Yield the groups of points one by one: there may be many."""
    last: Batch | None = None
    for point in sorted(points, key=lambda point: (point.area, point.width, point.read_span.start)):
        joined = None if last is None else _joined(last, point, rules, holes)
        if joined is None and last is not None:
            yield last
        last = joined or _batch((point,))
    if last is not None:
        yield last


def _batch(points: tuple[Point, ...]) -> Batch:
    spans = [point.read_span for point in points]
    first = spans[0].start
    return Batch(Span(spans[0].area, first, max(span.end for span in spans) - first), points)


def _joined(batch: Batch, point: Point, rules: ReadRules, holes: Holes) -> Batch | None:
    """Add a point to the batch, behind whose start it is; None if they cannot be read together."""
    span, added, width = batch.span, point.read_span, batch.points[0].width
    count = max(span.end, added.end) - span.start
    if point.area != span.area or point.width != width or count > rules.most(span.area, width):
        return None
    hole = Span(span.area, span.end, added.start - span.end)
    if hole.count > 0 and (not rules.allows(hole) or holes.refuse(hole)):
        return None
    return Batch(Span(span.area, span.start, count), (*batch.points, point))
