"""Any kind of device that a profile describes: its functions, limits, addresses and times, and values for its points.

Each point has a plausible value; those that are neither written nor set change slowly. What is written stays; what is
written at `write_at` appears at the point's own address. All other coils and registers hold 0.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.errors import RequestError
from gateway.images.tables import LAST_ADDRESS
from gateway.modbus.codes import Area
from gateway.modbus.functions import READING_IDENTIFICATION
from gateway.modbus.pdu import RequestPdu, Span, exception_response
from gateway.profiles.identity import Identity
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, covers
from gateway.registers.datatypes import BYTE_TYPES
from gateway.registers.items import WIDE_REGISTER, has_bits
from gateway.registers.numbers import parse_number
from gateway.simulator.device import Device, Mode
from gateway.simulator.faults import NO_FAULTS, Faults
from gateway.simulator.identification import identification, objects, telling_registers
from gateway.simulator.plausible import Course
from gateway.simulator.point_values import (
    Texts,
    choice,
    course,
    encoded,
    exponent_of,
    means_no_value,
    put,
    typed,
    without_value,
)

_EVERYWHERE: Final = ((0, LAST_ADDRESS),)
_NO_IDENTITY: Final = Identity()
#: The powers of ten that a scale register can have.
_EXPONENTS: Final = range(-10, 11)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of device: its profile, what its registers mean, and who makes it. `mode` is its only one, if it has."""

    profile: Profile
    points: tuple[Point, ...] = ()
    maker: str = ""
    mode: Mode | None = None


class Profiled(Device):
    """A device of a `kind`. `settings` are fixed values of points by name, as text; the word `invalid` for no value.

    Units, and other seeds, have other values.

    Raises:
        ValueError: there is no such point, or it cannot hold the value.
    """

    def __init__(
        self,
        unit: int,
        kind: Kind,
        settings: Mapping[str, str] | None = None,
        *,
        seed: int = 0,
        baud: int | None = None,
        faults: Faults = NO_FAULTS,
    ) -> None:
        profile, settings = kind.profile, settings or {}
        areas = {area: profile.areas.get(area, _EVERYWHERE) for area in Area}
        super().__init__(unit, profile, areas, {}, baud=baud, faults=faults)
        if kind.mode is not None:
            self.modes = frozenset({kind.mode})
        self.broadcasts = profile.broadcasts
        self.kind = kind
        identity = profile.identity or _NO_IDENTITY
        self._objects = objects(kind.maker, profile.title or profile.name, identity) if identity.fc43 else {}
        #: The contents of registers with four bytes, by area and address; others are 0.
        self._wide: dict[tuple[Area, int], bytes] = {}
        self._seed = f"{seed} {profile.name} {unit}"
        self._began: float | None = None
        self._exponents: dict[tuple[Area, int], int] = {}
        #: The points that change, each with its course.
        self._moving: list[tuple[Point, Course]] = []
        self._fill(settings)
        for area, address, data in telling_registers(identity, kind.points):
            self.put(Span(area, address, len(data) // 2), data)

    def items(self, span: Span) -> bytes:
        """Return the items of a span: a byte for each coil or input, two or four for each register."""
        if has_bits(span.area):
            return bytes(self.tables[span.area].values(span.start, span.count))
        if not self._is_wide(span):
            return self.tables[span.area].read(span)
        zero = bytes(WIDE_REGISTER)
        return b"".join(self._wide.get((span.area, at), zero) for at in range(span.start, span.end))

    def put(self, span: Span, items: bytes) -> None:
        """Set the items of a span.

        Raises:
            ValueError: some do not exist.
        """
        if has_bits(span.area):
            self.tables[span.area].assign(span.start, items)
        elif self._is_wide(span):
            at = [items[start : start + WIDE_REGISTER] for start in range(0, len(items), WIDE_REGISTER)]
            self._wide |= {(span.area, span.start + index): each for index, each in enumerate(at)}
        elif self.tables[span.area].has(span):
            self.tables[span.area].write(span, items)
        else:
            raise ValueError(f"profile {self.profile.name} has no {span.area} {span.addresses}")

    def perform(self, asked: RequestPdu, now: float, baud: int) -> bytes:
        """Execute a checked request on the values that there are now."""
        if self._began is None:
            self._began = now
        if asked.read is not None:
            self._move(asked.read, now - self._began)
        response = self._perform(asked, now, baud)
        if asked.write is not None:
            self._written(asked.write)
        return response

    def _act(self, pdu: bytes, now: float, baud: int) -> tuple[float, bytes]:
        if not self._objects or not pdu.startswith(READING_IDENTIFICATION):
            return super()._act(pdu, now, baud)
        try:
            return self.answer_time, identification(pdu, self._objects)
        except RequestError as error:
            return self.answer_time, exception_response(pdu[0], error.code)

    def _perform(self, asked: RequestPdu, now: float, baud: int) -> bytes:
        span = asked.write or asked.read
        if span is None or not self._is_wide(span):
            return super().perform(asked, now, baud)
        if asked.write is not None:
            self.put(span, asked.values)
            return asked.response_head
        data = self.items(span)
        return bytes((asked.function, len(data))) + data

    def _is_wide(self, span: Span) -> bool:
        return span.area in self.profile.wide and covers(self.profile.wide[span.area], span)

    def _fill(self, settings: Mapping[str, str]) -> None:
        """Set all points: first the scales, then bits, whole registers over these, and at last what is set."""
        named = {point.name: point for point in self.kind.points}
        for name in settings:
            if name not in named:
                raise ValueError(f"{self.profile.name} has no point {name}")
        self._fill_scales(settings, named)
        places = Counter(self._places())
        for point in sorted(self.kind.points, key=lambda point: point.bits is None):
            if (point.area, point.address) not in self._exponents or point.bits is not None:
                self._fill_point(point, is_alone=all(places[place] == 1 for place in _places_of(point.span)))
        for name, text in settings.items():
            self._keep(named[name].span)
            self._put_text(named[name], text)

    def _fill_scales(self, settings: Mapping[str, str], named: Mapping[str, Point]) -> None:
        """Choose the powers of ten in scale registers, and set these."""
        scaled = defaultdict[tuple[Area, int], list[Point]](list)
        for point in self.kind.points:
            if point.scale_at is not None:
                scaled[point.area, point.scale_at].append(point)
        given = {(named[name].area, named[name].address): text for name, text in settings.items()}
        for place, points in scaled.items():
            number = parse_number(given.get(place, ""))
            is_given = number is not None and number in _EXPONENTS
            self._exponents[place] = int(number or 0) if is_given else exponent_of(points, self._seed)
            area, address = place
            width = points[0].width
            self.put(Span(area, address, 1), self._exponents[place].to_bytes(2, "big", signed=True).ljust(width, b"\0"))

    def _fill_point(self, point: Point, *, is_alone: bool) -> None:
        texts = Texts(self.kind.maker, self.profile.title or self.profile.name)
        text = choice(point, texts, self._seed)
        if text is not None:
            self._put_text(point, text)
            return
        way = course(point, self._exponent(point), self._seed, steady=not is_alone or point.write != "no")
        self._put_value(point, way.at(0.0))
        if way.moves:
            self._moving.append((point, way))

    def _move(self, span: Span, seconds: float) -> None:
        """Bring the points in a span up to date."""
        for point, way in self._moving:
            if span.touches(point.span):
                self._put_value(point, way.at(seconds))

    def _keep(self, span: Span) -> None:
        """Let no value change that is in a span, or has its scale there."""
        self._moving = [(point, way) for point, way in self._moving if not span.touches(point.read_span)]

    def _written(self, span: Span) -> None:
        """Keep what a client wrote, and show it where it is read."""
        self._keep(span)
        for point in self.kind.points:
            if point.write_at is not None and span.touches(point.write_span):
                self._put_point(point, self.items(point.write_span), copy=False)

    def _exponent(self, point: Point) -> int:
        return 0 if point.scale_at is None else self._exponents[point.area, point.scale_at]

    def _put_text(self, point: Point, text: str) -> None:
        if not means_no_value(point, text):
            self._put_point(point, typed(point, text, self.items(point.read_span)))
        elif point.type in BYTE_TYPES:
            self._put_point(point, without_value(point))
        else:
            self.put(point.span, without_value(point))

    def _put_value(self, point: Point, value: float) -> None:
        self._put_point(point, encoded(point, value, self._exponent(point), self.items(point.read_span)))

    def _put_point(self, point: Point, own: bytes, *, copy: bool = True) -> None:
        """Set a point, also where it is written."""
        self.put(point.span, put(point, own, self.items(point.span)))
        if copy and point.write_at is not None:
            self.put(point.write_span, put(point, own, self.items(point.write_span)))

    def _places(self) -> Iterator[tuple[Area, int]]:
        """Yield each place as often as something is there: points, where they are written, what tells the kind."""
        for point in self.kind.points:
            yield from _places_of(point.span)
            if point.write_at is not None:
                yield from _places_of(point.write_span)
        for area, address, data in telling_registers(self.profile.identity or _NO_IDENTITY, self.kind.points):
            yield from _places_of(Span(area, address, len(data) // 2))


def _places_of(span: Span) -> Sequence[tuple[Area, int]]:
    return [(span.area, address) for address in range(span.start, span.end)]
