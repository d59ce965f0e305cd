"""The encoded numbers in the items of a point: found and made by functions that are prepared for it once.

`Point.items` and `Point.value` do the same for a value at a time, and for labels.
"""

from collections.abc import Callable
from functools import lru_cache
from math import isfinite
from operator import itemgetter
from struct import Struct
from typing import Final

from gateway.profiles.point import Point
from gateway.registers.datatypes import is_whole, shortest, swapped
from gateway.registers.items import has_bits

#: Puts bytes into another order.
Order = Callable[[bytes], bytes]
#: Finds the number, or the text, in the items of a point's `read_span`; None if they have no value.
Decode = Callable[[bytes], float | str | None]
#: Makes items for a number; None if it does not fit.
Encode = Callable[[float], bytes | None]

_FLOATS: Final = {"float32": Struct(">f"), "float64": Struct(">d")}


@lru_cache(maxsize=256)
def arranged(swap: str, size: int, chunk: int = 0) -> Order:
    """Make what swaps so many bytes, as the registers of one value, or of several that have `chunk` bytes each."""
    places = bytes(range(size))
    chunk = chunk or size
    return by_places([at for start in range(0, size, chunk) for at in swapped(places[start : start + chunk], swap)])


def by_places(order: list[int]) -> Order:
    """Make what takes the bytes at these places, in this order."""
    if order == list(range(len(order))):
        return bytes
    pick = itemgetter(*order)
    return lambda items: bytes(pick(items))


def finite(point: Point) -> Callable[[bytes], bool]:
    """Make what tells whether the own items of a point, whose type holds floats, are a number and not infinite."""
    order, unpack = arranged(point.swap, point.count * point.width), _FLOATS[point.type].unpack
    return lambda items: isfinite(unpack(order(items))[0])


def decoder(point: Point) -> Decode:
    """Make what finds the encoded number, or the text, in the items of a point's `read_span`."""
    if has_bits(point.area):
        return lambda items: items[0]
    order, invalid = arranged(point.swap, point.count * point.width), point.invalid
    if point.scale_at is not None or point.bits is not None:
        return lambda items: point.carried(point.own(items))
    if point.type in _FLOATS:
        unpack, shorter = _FLOATS[point.type].unpack, shortest if point.type == "float32" else float

        def floating(items: bytes) -> float | None:
            number = unpack(order(items))[0]
            if not isfinite(number):
                return None
            number = shorter(number)
            return None if number in invalid else number

        return floating
    if _is_binary(point.type):
        signed = point.type.startswith("int")

        def whole(items: bytes) -> int | None:
            number = int.from_bytes(order(items), "big", signed=signed)
            return None if number in invalid else number

        return whole
    return point.carried


def encoder(point: Point) -> Encode:
    """Make what encodes a number as a point's own items. For types of whole numbers it takes only these."""
    if has_bits(point.area):
        return lambda number: bytes((int(number),)) if number in (0, 1) else None
    if point.bits is None and point.type in _FLOATS:
        return _float_encoder(point)
    if point.bits is None and _is_binary(point.type):
        return _whole_encoder(point)
    return _other_encoder(point)


def _float_encoder(point: Point) -> Encode:
    order, pack = arranged(point.swap, point.count * point.width), _FLOATS[point.type].pack

    def items(number: float) -> bytes | None:
        try:
            return order(pack(number))
        except OverflowError:
            return None

    return items


def _whole_encoder(point: Point) -> Encode:
    size, signed = point.count * point.width, point.type.startswith("int")
    order = arranged(point.swap, size)

    def items(number: float) -> bytes | None:
        try:
            return order(int(number).to_bytes(size, "big", signed=signed))
        except OverflowError:
            return None

    return items


def _other_encoder(point: Point) -> Encode:
    """Make what encodes BCD, and numbers that have only some bits of their registers."""
    least, greatest = point.least_and_greatest
    return lambda number: point.carrying(number) if least <= number <= greatest else None


def _is_binary(data_type: str) -> bool:
    return is_whole(data_type) and data_type.lstrip("u").startswith("int")
