"""Numbers out of the responses to a read, by functions that are prepared for it once."""

from collections.abc import Callable, Iterable, Iterator
from decimal import Decimal
from typing import Final, NamedTuple

from gateway.modbus.pdu import Span
from gateway.profiles.coding import decoder
from gateway.profiles.point import Point
from gateway.registers.datatypes import is_float
from gateway.registers.items import has_bits, items_read
from gateway.timing.trend import GREATEST

#: Finds the value in the items of a point's `read_span`; None if it is no number.
ToNumber = Callable[[bytes], float | None]
#: No double has more digits behind the point.
_MOST_PLACES: Final = 15


class Read(NamedTuple):
    """A read: its span, the bytes of its registers, its points that have trends, and the place and value of each."""

    span: Span
    width: int
    points: tuple[Point, ...]
    places: tuple[tuple[slice, ToNumber], ...]

    @classmethod
    def of(cls, span: Span, points: Iterable[Point]) -> "Read":
        """Prepare the values of these points, as far as the read has all of them."""
        covered = tuple(point for point in points if has_trend(point) and span.has(point.read_span))
        width = covered[0].width if covered else 0
        size = 1 if has_bits(span.area) else width
        places = []
        for point in covered:
            start = (point.read_span.start - span.start) * size
            places.append((slice(start, start + point.read_span.count * size), to_number(point)))
        return cls(span, width, covered, tuple(places))

    def numbers(self, response: bytes) -> Iterator[float | None]:
        """Yield the number of each point in a response; none of all if its length is another one."""
        if not self.points:
            return
        try:
            items = items_read(self.span, response, self.width)
        except ValueError:
            return
        for place, number_in in self.places:
            yield number_in(items[place])


def has_trend(point: Point) -> bool:
    """Return whether the values of a point of a device are numbers that can be read."""
    return point.type != "string" and point.write != "only"


def to_number(point: Point) -> ToNumber:
    """Make what finds the value of a point that is not text, as `Point.value` does; labels are no numbers."""
    if point.scale_at is not None:

        def slowly(items: bytes) -> float | None:
            value = point.value(items)
            return None if value is None or isinstance(value, str) or abs(value) > GREATEST else float(value)

        return slowly
    decode, labels = decoder(point), frozenset() if is_float(point.type) else frozenset(point.labels)
    scale, offset = (1.0, 0.0) if has_bits(point.area) else (point.scale, point.offset)
    places = _places(point)

    def quickly(items: bytes) -> float | None:
        carried = decode(items)
        if carried is None or isinstance(carried, str) or carried in labels:
            return None
        number = round(carried * scale + offset, places)
        return number if abs(number) <= GREATEST else None

    return quickly


def _places(point: Point) -> int:
    """Find how many digits behind the point a value can have."""
    if point.decimals is not None:
        return point.decimals
    if is_float(point.type):
        return _MOST_PLACES
    exponents = (Decimal(repr(number)).normalize().as_tuple().exponent for number in (point.scale, point.offset))
    return max(0, *(-each for each in exponents if isinstance(each, int)))
