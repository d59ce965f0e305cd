"""Groups points into as few requests as the device allows, without reading other addresses."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.registers.items import MOST_WIDE, REGISTER, items_read, read_request


class Batch(NamedTuple):
    """Points that one request reads, all of them in `span`."""

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


def batches(points: Iterable[Point], limits: Mapping[int, int]) -> list[Batch]:
    """Group points by area and address. `limits` is the most items that the device allows for a function."""
    found: list[Batch] = []
    for point in sorted(points, key=lambda point: (point.area, point.width, point.read_span.start)):
        joined = _joined(found[-1], point, limits) if found else None
        if joined is None:
            found.append(Batch(point.read_span, (point,)))
        else:
            found[-1] = joined
    return found


def _joined(batch: Batch, point: Point, limits: Mapping[int, int]) -> Batch | None:
    """Add a point to the batch; None if there is a gap before it or the request would be too long."""
    span, added, width = batch.span, point.read_span, batch.points[0].width
    function, most = READERS[span.area]
    if width > REGISTER:
        most = MOST_WIDE
    count = max(span.end, added.end) - span.start
    is_apart = point.area != span.area or point.width != width or added.start > span.end
    if is_apart or count > min(most, limits.get(function, most)):
        return None
    return Batch(Span(span.area, span.start, count), (*batch.points, point))
