"""The values of a simulated device's points: chosen so that they fit, and encoded as the gateway encodes them."""

from dataclasses import dataclass
from decimal import Decimal
from math import ceil, floor, inf, nan
from random import Random
from typing import Final

from gateway.profiles.point import Point
from gateway.registers.datatypes import BYTE_TYPES, encode, is_float, swapped
from gateway.registers.items import has_bits
from gateway.simulator.plausible import Course, course_of

#: `--set POINT=invalid`: the device has no value there.
INVALID: Final = "invalid"
#: Words in the names of bits that are 0 in a device that is well.
_TROUBLE: Final = ("alarm", "fault", "error", "warning", "trip")
#: Labels of a device that is well and works.
_WELL: Final = ("on", "running", "producing", "mppt", "on grid", "normal", "ok", "auto")
#: Where values of floating-point types lie that have no limits.
_FLOATS: Final = 1e12
#: Powers of ten for scale registers, the finest first. Numbers fill a half of their type, to grow.
_EXPONENTS: Final = range(-3, 11)
_ROOM: Final = 0.5
#: How far from a number that is no value another one is looked for.
_NEIGHBOURS: Final = 64


@dataclass(frozen=True, slots=True)
class Texts:
    """What a device says about itself in its strings."""

    maker: str
    title: str

    def text(self, point: Point) -> str:
        """Choose the text of a point; it fits."""
        words = {"serial": "SIM-0001", "version": "1.0", "maker": self.maker, "manufacturer": self.maker}
        text = next((words[word] for word in words if word in point.name), self.title)
        room = point.count * (point.width if point.bits is None else 1)
        return text.encode()[:room].decode("utf-8", "ignore")


def exponent_of(points: list[Point], seed: str) -> int:
    """Choose the power of ten for the points that share a scale register: the finest with which all fit."""
    for exponent in _EXPONENTS:
        if all(_fits(point, exponent, seed) for point in points):
            return exponent
    return _EXPONENTS[-1]


def course(point: Point, exponent: int, seed: str, *, steady: bool) -> Course:
    """Choose how the value of a point with a number changes."""
    least, greatest = _range(point, exponent)
    return course_of(point.name, point.unit, least, greatest, _dice(point, seed), steady=steady)


def choice(point: Point, texts: Texts, seed: str) -> str | None:
    """Choose the value of a point that has labels, a bit or text; None for one that has a number."""
    if point.type == "string":
        return texts.text(point)
    if point.labels:
        first, last = _numbers(point, 0)
        fits = [label for number, label in point.labels.items() if first <= number <= last]
        fits = [label for label in fits if point.value(point.items(label)) is not None]
        return next((label for label in fits if label.lower() in _WELL), fits[0] if fits else None)
    if point.is_bit:
        is_trouble = any(word in point.name for word in _TROUBLE)
        return "0" if is_trouble else str(_dice(point, seed).randrange(2))
    return None


def encoded(point: Point, value: float, exponent: int, before: bytes) -> bytes:
    """Encode about `value`, as near to it as the type allows: a number that means neither nothing nor a label.

    `before` are the items of the point's `read_span`.
    """
    if is_float(point.type):
        least, greatest = _range(point, exponent)
        return point.items(repr(min(max(float(f"{value:.7g}"), least), greatest)), before)
    scale, offset = _factor(point, exponent), Decimal(repr(point.offset))
    first, last = _numbers(point, exponent)
    nearest = min(max(round((Decimal(value) - offset) / scale), first), last)
    above = range(nearest + 1, min(nearest + _NEIGHBOURS, last) + 1)
    below = range(nearest - 1, max(nearest - _NEIGHBOURS, first) - 1, -1)
    for number in (nearest, *above, *below):
        if number not in point.invalid and number not in point.labels:
            return point.items(str(number * scale + offset), before)
    return point.items(str(nearest * scale + offset), before)


def without_value(point: Point) -> bytes:
    """Encode that there is no value; of bits, in all of their register.

    Raises:
        ValueError: the point has no number for that.
    """
    size = point.count * point.width
    if point.type.startswith("bcd"):
        return b"\xff" * size
    if not point.invalid and not is_float(point.type):
        raise ValueError(f"{point.name} has no number that means that there is no value")
    number = point.invalid[0] if point.invalid else nan
    if point.bits is None:
        return encode(number, point.type, point.swap)
    whole = (int(number) << point.bits[0]) & point.mask if point.type in BYTE_TYPES else int(number)
    return swapped(whole.to_bytes(size, "big"), point.swap)


def typed(point: Point, text: str, before: bytes) -> bytes:
    """Encode a value that was typed as text.

    Raises:
        ValueError: the point cannot hold it.
    """
    if point.type == "string" and point.bits is not None:  # one character in each register
        characters = encode(text, "string", length=(point.count + 1) // 2)[: point.count]
        return b"".join(bytes((each, each)) for each in characters)
    return point.items(text, before)


def means_no_value(point: Point, text: str) -> bool:
    """Tell whether the text stands for no value."""
    return text == INVALID and text not in point.labels.values() and point.type != "string"


def put(point: Point, own: bytes, before: bytes) -> bytes:
    """Put the items of a point among those of its registers: other bits stay as they were."""
    if point.bits is None or has_bits(point.area):
        return own
    if point.type == "string":
        kept, at = bytearray(before), 1 if point.bits[0] == 0 else 0
        kept[at::2] = own[at::2]
        return bytes(kept)
    old, new = (int.from_bytes(swapped(each, point.swap), "big") for each in (before, own))
    return swapped((old & ~point.mask | new & point.mask).to_bytes(len(own), "big"), point.swap)


def _fits(point: Point, exponent: int, seed: str) -> bool:
    least, greatest = _range(point, exponent)
    free = course_of(point.name, point.unit, -inf, inf, _dice(point, seed))
    return least * _ROOM <= free.middle <= greatest * _ROOM


def _range(point: Point, exponent: int) -> tuple[float, float]:
    """Find the least and the greatest value of a point."""
    if is_float(point.type):
        least = -_FLOATS if point.minimum is None else point.minimum
        return least, _FLOATS if point.maximum is None else point.maximum
    scale, offset = _factor(point, exponent), Decimal(repr(point.offset))
    ends = sorted(float(number * scale + offset) for number in _numbers(point, exponent))
    return ends[0], ends[1]


def _numbers(point: Point, exponent: int) -> tuple[int, int]:
    """Find the least and the greatest encoded number with a value within the limits."""
    least, greatest = point.least_and_greatest
    scale, offset = _factor(point, exponent), Decimal(repr(point.offset))
    low, high = (
        None if each is None else (Decimal(repr(each)) - offset) / scale for each in (point.minimum, point.maximum)
    )
    if scale < 0:
        low, high = high, low
    return max(least, least if low is None else ceil(low)), min(greatest, greatest if high is None else floor(high))


def _factor(point: Point, exponent: int) -> Decimal:
    return Decimal(repr(point.scale)).scaleb(exponent)


def _dice(point: Point, seed: str) -> Random:
    return Random(f"{seed} {point.name}")  # noqa: S311 - not a secret, and repeatable
