"""Guards: registers of points with limits, which are written whole and within these limits, or not at all.

A guard looks at requests, whoever sends them. Function 22 does not tell what a register becomes, so it is refused
there, and so is what writes a part of a point. Without limits nothing is guarded, whatever labels and type say.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Final

from gateway.errors import IllegalValue
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import ADDRESSES, RequestPdu, Span
from gateway.profiles.point import Point
from gateway.registers.items import REGISTER, has_bits

#: The most registers that a number takes.
_LONGEST: Final = 4


@dataclass(frozen=True, slots=True)
class Guard:
    """A point with limits, and its `place`: the registers that are written for it.

    If only bits count, that are the registers that have them, `at` registers behind the first one of the point.
    """

    point: Point
    place: Span
    at: int = 0

    @classmethod
    def of(cls, point: Point) -> "Guard":
        """Make the guard of a point with limits."""
        place = point.write_span
        if point.bits is None:
            return cls(point, place)
        own = [at for at, mask in enumerate(point.register_masks) if mask]
        return cls(point, Span(place.area, place.start + own[0], own[-1] - own[0] + 1), own[0])

    def check(self, asked: RequestPdu, span: Span) -> None:
        """Check a write to `span`, which touches it.

        Raises:
            IllegalValue: it does not write the whole point, or no value within the limits.
        """
        items = asked.row.writes
        if asked.function == FunctionCode.MASK_WRITE_REGISTER or items is None:
            raise IllegalValue(f"{self.point.rule}, and function {asked.function} does not tell what it becomes")
        if not span.has(self.place):
            raise self._of_a_part()
        start, size = items.width * (self.place.start - span.start), items.width * self.place.count
        self._check_number(asked.values[start : start + size])

    def check_bits(self, mask: int, bits: int) -> None:
        """Check a write of `bits` where `mask` is 1 in one of its registers, which is read before it is written.

        What it leaves as it is cannot be checked before that. Raises as `check`.
        """
        if self.place.count > 1:
            raise self._of_a_part()
        own = self.point.register_masks[self.at]
        if own & mask == own:
            self._check_number((bits & mask).to_bytes(REGISTER, "big"))
        elif own & mask:
            raise self._of_a_part()

    def _check_number(self, items: bytes) -> None:
        """Check the items of its place."""
        point = self.point
        behind = point.count - self.at - self.place.count
        number = point.carried(bytes(self.at * point.width) + items + bytes(behind * point.width))
        if number is None or isinstance(number, str):
            raise IllegalValue(f"{point.rule}, and this is no value")
        least, greatest = _numbers_within(point.minimum, point.maximum, point.scale, point.offset)
        exact = number if isinstance(number, int) else _exact(number)
        if (least is not None and exact < least) or (greatest is not None and exact > greatest):
            value = _exact(number) * _exact(point.scale) + _exact(point.offset)
            raise IllegalValue(f"{point.rule}, not {_shown(value)}")

    def _of_a_part(self) -> IllegalValue:
        what = f"{self.place.area} {self.place.addresses}"
        return IllegalValue(f"{self.point.rule}: one write must set all of {what}")


@dataclass(frozen=True, slots=True)
class Guards:
    """The guards of a device, in the order of their places. Each must hold."""

    all: tuple[Guard, ...] = ()

    @classmethod
    def of(cls, points: Iterable[Point]) -> "Guards":
        """Make the guards of those points that have limits and can be written."""
        guarded = (each for each in points if each.is_guarded and not has_bits(each.area) and each.type != "string")
        return cls(tuple(sorted(map(Guard.of, guarded), key=_start)))

    @property
    def points(self) -> tuple[Point, ...]:
        """The points that are guarded."""
        return tuple(guard.point for guard in self.all)

    def __bool__(self) -> bool:
        """Tell whether there is one."""
        return bool(self.all)

    def check(self, asked: RequestPdu) -> None:
        """Check what a request writes.

        Raises:
            IllegalValue: a guard that it touches does not hold.
        """
        if asked.write is not None:
            for guard in self.touched(asked.write):
                guard.check(asked, asked.write)

    def check_bits(self, span: Span, mask: int, bits: int) -> None:
        """Check a write to bits of the register at `span`, as far as is known before it is read.

        Raises:
            IllegalValue: a guard that it touches does not hold.
        """
        for guard in self.touched(span):
            guard.check_bits(mask, bits)

    def touch(self, span: Span) -> bool:
        """Tell whether one of them has a register of `span`."""
        return next(self.touched(span), None) is not None

    def touched(self, span: Span) -> Iterator[Guard]:
        """Yield the guards that have a register of `span`. A device may go on at address 0 after the last one."""
        if span.area is Area.HOLDING:
            for guard in self.all[bisect_left(self.all, span.start - _LONGEST + 1, key=_start) :]:
                if guard.place.start >= span.end:
                    break
                if guard.place.end > span.start:
                    yield guard
            if span.end > ADDRESSES:
                yield from self.touched(Span(span.area, 0, span.end - ADDRESSES))


#: Of a device without limits.
NO_GUARDS: Final = Guards()


def _start(guard: Guard) -> int:
    return guard.place.start


@lru_cache(maxsize=1024)
def _numbers_within(
    minimum: float | None, maximum: float | None, scale: float, offset: float
) -> tuple[Fraction | None, Fraction | None]:
    """Compute the least and the greatest number in the registers for these limits of the value."""
    first, last = (
        None if each is None else (_exact(each) - _exact(offset)) / _exact(scale) for each in (minimum, maximum)
    )
    return (first, last) if scale > 0 else (last, first)


def _exact(number: float) -> Fraction:
    """Take a number as the decimal that it is written as: 0.1 is one tenth."""
    return Fraction(repr(number))


def _shown(value: Fraction) -> str:
    return f"{Decimal(value.numerator) / Decimal(value.denominator):.15g}"
