"""Numbers out of the responses to a read, by functions that are prepared for it once."""

from collections.abc import Callable, Iterable
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
    """A read: its span, the bytes of its registers, and of each point the number of its trend, its place and value."""

    span: Span
    width: int
    points: tuple[tuple[int, slice, ToNumber], ...]

    @classmethod
    def of(cls, span: Span, points: Iterable[tuple[int, Point]]) -> "Read":
        """Prepare the values of these points, by the numbers of their trends, as far as the read has all of them."""
        covered = [
            (key, point)
            for key, point in points
            if has_trend(point) and span.start <= point.read_span.start and point.read_span.end <= span.end
        ]
        width = covered[0][1].width if covered else 0
        size = 1 if has_bits(span.area) else width
        places = []
        for key, point in covered:
            start = (point.read_span.start - span.start) * size
            places.append((key, slice(start, start + point.read_span.count * size), to_number(point)))
        return cls(span, width, tuple(places))

    def numbers(self, response: bytes) -> Iterable[tuple[int, float]]:
        """Yield the numbers in a response, by the numbers of their trends; none if its length is another one."""
        if not self.points:
            return
        try:
            items = items_read(self.span, response, self.width)
        except ValueError:
            return
        for key, place, number_in in self.points:
            number = number_in(items[place])
            if number is not None:
                yield key, number


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
