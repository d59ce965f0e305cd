"""What a recorded transaction means where its unit has points: their names and values, beside the numbers."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from gateway.errors import RequestError, WrongQuestion
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import RequestPdu, Span, parse_sent
from gateway.operator.operations.answers.trace import Fact, Meanings, Meant
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.asked import ToUnderstand
from gateway.operator.operations.operation import Asker
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operator import Operator, until_reload
from gateway.operator.units.units import picture, units_of
from gateway.profiles.point import Point
from gateway.registers.items import has_bits, unpack_bits

#: So many points of each transaction are told; the others are counted.
FEW: Final = 3
#: The points of so many different requests are known by heart: clients repeat theirs.
_MOST_KNOWN: Final = 1024
_ON: Final = 0xFF


class _Place(NamedTuple):
    """Where the items of a point are among those of a span: the first of them, and their number."""

    point: Point
    first: int
    items: int


class Points:
    """The points of all units, by the names that records have for these."""

    def __init__(self, units: Iterable[UnitPicture]) -> None:
        self._points = {unit.name: unit.points for unit in units if unit.points}
        self._places: dict[tuple[str, Span, bool], Sequence[_Place]] = {}

    def meant(self, fact: Fact, most: int | None = None) -> tuple[Sequence[Meant], int]:
        """Tell what a fact means: at most so many points, and how many more there are."""
        name, request = fact.get("device") or fact.get("name") or "", fact.get("request")
        if name not in self._points or not request:
            return (), 0
        response = bytes.fromhex(fact.get("response") or "")
        told: list[Meant] = []
        count = 0
        for places, items, size in self._parts(name, bytes.fromhex(request), response):
            count += len(places)
            room = len(places) if most is None else most - len(told)
            told += [_meant(point, items[first * size : (first + many) * size]) for point, first, many in places[:room]]
        return told, count - len(told)

    def beside(self, fact: Fact, most: int = FEW) -> Fact:
        """Add to a fact what it means; nothing if it covers no point."""
        meant, more = self.meant(fact, most)
        return fact | {"points": [fields_of(each) for each in meant], "more_points": more} if meant else fact

    def _parts(self, name: str, request: bytes, response: bytes) -> Iterator[tuple[Sequence[_Place], bytes, int]]:
        """Yield what was written and what was read: places of points, and the items with the size of each."""
        try:
            asked = parse_sent(request)
        except RequestError:
            return
        if asked.write is not None and (written := _written(asked)):
            yield self._part(name, asked.write, written, is_written=True)
        if asked.read is not None and response and not response[0] & EXCEPTION_BIT:
            yield self._part(name, asked.read, response[2:], is_written=False)

    def _part(self, name: str, span: Span, data: bytes, *, is_written: bool) -> tuple[Sequence[_Place], bytes, int]:
        items = unpack_bits(data, span.count) if has_bits(span.area) else data
        size, rest = divmod(len(items), span.count)
        places = self._within(name, span, is_written=is_written)
        is_whole = not rest and (has_bits(span.area) or all(place.point.width == size for place in places))
        return places if is_whole else (), items, size

    def _within(self, name: str, span: Span, *, is_written: bool) -> Sequence[_Place]:
        """List the places of the points that lie in a span as a whole, by address."""
        key = name, span, is_written
        found = self._places.get(key)
        if found is None:
            if len(self._places) >= _MOST_KNOWN:
                self._places.clear()
            there = _those_written if is_written else _those_read
            ordered = sorted(there(self._points[name]), key=lambda each: each[1].start)
            found = self._places[key] = [
                _Place(point, place.start - span.start, place.count) for point, place in ordered if span.has(place)
            ]
        return found


@until_reload
def points_of(operator: Operator) -> Points:
    """Collect the points of all units."""
    return Points(units_of(operator))


async def tell_meaning(operator: Operator, asked: ToUnderstand, _asker: Asker) -> Meanings:
    """Return what a request to a unit and its response mean: all points that they cover.

    Raises:
        WrongQuestion: there is no such unit, or the bytes are none.
    """
    fact: Fact = {"name": picture(operator, asked.unit).name, "request": asked.request}
    try:
        return Meanings(tuple(points_of(operator).meant(fact | {"response": asked.response})[0]))
    except ValueError:
        raise WrongQuestion('"request" and "response" must be bytes in hexadecimal') from None


def _written(asked: RequestPdu) -> bytes:
    """Return the values of a write, packed as in a response; empty if they are not in the request."""
    if asked.function == FunctionCode.WRITE_SINGLE_COIL:
        return bytes((asked.data[3] == _ON,))
    return asked.values


def _those_read(points: Sequence[Point]) -> Iterator[tuple[Point, Span]]:
    return ((point, point.read_span) for point in points if point.write != "only")


def _those_written(points: Sequence[Point]) -> Iterator[tuple[Point, Span]]:
    """Yield points with their places for writes. A scale that is not written with them is not known."""
    for point in points:
        if point.write != "no" and point.scale_at is None:
            yield replace(point, invalid=()), point.write_span


def _meant(point: Point, items: bytes) -> Meant:
    value = point.value(items)
    text = point.show(value)
    return Meant(point.name, value, f"{text} {point.unit}" if point.unit else text)
