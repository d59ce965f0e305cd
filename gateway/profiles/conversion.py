"""The value of one point in the encoding of another, exactly: without labels, and not rounded as for display.

A value is the encoded number times the scale plus the offset, all of these as decimals; a float is the shortest decimal
that gives it. Where the target holds whole numbers the result is rounded, halves away from zero.
"""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from math import lcm

from gateway.profiles.coding import Decode, Order, by_places, decoder, encoder, finite
from gateway.profiles.point import Point
from gateway.registers.datatypes import encode, is_float, swapped
from gateway.registers.items import REGISTER, has_bits


class Conversion:
    """Turns what was read of `source` into the own items of `target`; without one, into its own items as they are.

    What it computes for a point is prepared, for this is done at each poll.
    """

    def __init__(self, source: Point, target: Point | None) -> None:
        self.source = source
        self.target = target or source
        self._number = decoder(source)
        self._items = encoder(self.target)
        self._order = _order(source, target)
        self._is_valid = _validity(source, self.target, self._number)
        #: By the exponents of both: number there = (number here * factor + summand) / divisor.
        self._lines: dict[tuple[int, int], tuple[int, int, int]] = {}

    def __call__(self, items: bytes, before: bytes | None = None) -> bytes | None:
        """Convert the items of the source's `read_span`; `before` are those of the target, if it has a scale register.

        None if there is no value, or it does not fit.
        """
        source, target = self.source, self.target
        if self._order is not None:
            return self._order(source.own(items)) if self._is_valid is None or self._is_valid(items) else None
        number, exponent = self._number(items), source.exponent(items)
        if number is None or exponent is None:
            return None
        if isinstance(number, str):
            return _text(number, target)
        scale = 0 if target.scale_at is None else None if before is None else target.exponent(before)
        if scale is None or target.type == "string":
            return None
        carried = self._converted(number, exponent, scale)
        return None if carried is None or carried in target.invalid else self._items(carried)

    def has_value(self, items: bytes) -> bool:
        """Tell whether the items of the source's `read_span` have a value, which perhaps does not fit."""
        return self._number(items) is not None and self.source.exponent(items) is not None

    def _converted(self, number: float, exponent: int, scale: int) -> float | None:
        """Compute the encoded number of the target; None if it is too large for a float."""
        line = self._lines.get((exponent, scale))
        if line is None:
            line = self._lines[exponent, scale] = self._line(exponent, scale)
        is_rounded = not is_float(self.target.type)
        if line == (1, 0, 1) and (isinstance(number, int) or not is_rounded):
            return number
        factor, summand, divisor = line
        above, below = (number, 1) if isinstance(number, int) else Decimal(repr(number)).as_integer_ratio()
        above, below = above * factor + summand * below, divisor * below
        if is_rounded:
            whole = (2 * abs(above) + below) // (2 * below)
            return whole if above >= 0 else -whole
        try:
            return above / below
        except OverflowError:
            return None

    def _line(self, exponent: int, scale: int) -> tuple[int, int, int]:
        unit = _decimal(self.target.scale) * Fraction(10) ** scale
        factor = _decimal(self.source.scale) * Fraction(10) ** exponent / unit
        summand = (_decimal(self.source.offset) - _decimal(self.target.offset)) / unit
        divisor = lcm(factor.denominator, summand.denominator)
        return int(factor * divisor), int(summand * divisor), divisor


def _order(source: Point, target: Point | None) -> Order | None:
    """Find the order in which the bytes of the source are what the target has; None if more is to be done."""
    if target is None:
        return bytes
    if has_bits(source.area) or has_bits(target.area):
        return None
    if source.bits is not None or target.bits is not None or source.type != target.type:
        return None
    size = source.count * source.width
    if size != target.count * target.width:
        return None
    is_text = source.type == "string"
    same_line = (source.scale, source.offset) == (target.scale, target.offset)
    if not is_text and (not same_line or source.scale_at is not None or target.scale_at is not None):
        return None
    return by_places(list(swapped(swapped(bytes(range(size)), source.swap), target.swap)))


def _validity(source: Point, target: Point, number: Decode) -> Callable[[bytes], bool] | None:
    """Make what tells whether items of the same encoding have a value; None if all have."""
    invalid = (*source.invalid, *target.invalid)
    if is_float(source.type) and not invalid and source.scale_at is None:
        return finite(source)
    if invalid or is_float(source.type) or source.type.startswith("bcd") or source.scale_at is not None:
        return lambda items: (
            (found := number(items)) is not None and found not in invalid and source.exponent(items) is not None
        )
    return None


def _text(text: str, target: Point) -> bytes | None:
    if target.type != "string" or target.bits is not None:
        return None
    try:
        return encode(text, "string", target.swap, target.count * target.width // REGISTER)
    except ValueError:
        return None


def _decimal(number: float) -> Fraction:
    """Take a number as the decimal that it is written as: 0.1 is one tenth."""
    return Fraction(repr(number))
