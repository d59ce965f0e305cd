"""How registers carry values, and how a value looks elsewhere: written anew, with fractions, for comparison."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import floor, isfinite

Number = Fraction | str

_SIZES = {
    **dict.fromkeys(("uint16", "int16", "bcd16", "uint8", "int8"), 1),
    **dict.fromkeys(("uint32", "int32", "bcd32", "float32"), 2),
    **dict.fromkeys(("uint64", "int64", "float64"), 4),
}


def rounded(number: Fraction) -> int:
    """The nearest whole number; halves go away from zero."""
    whole = floor(abs(number) + Fraction(1, 2))
    return whole if number >= 0 else -whole


def turned(words: Sequence[int], swap: str) -> tuple[int, ...]:
    """Registers in another order of words, bytes or both."""
    found = list(words)
    if swap in ("words", "both"):
        found.reverse()
    if swap in ("bytes", "both"):
        found = [(word & 0xFF) << 8 | word >> 8 for word in found]
    return tuple(found)


@dataclass(frozen=True)
class Encoding:
    """How registers carry a value, or some bits of them do; `text` is the length of a text in registers."""

    type: str = "uint16"
    swap: str = "none"
    scale: str = "1"
    offset: str = "0"
    bits: tuple[int, int] | None = None
    invalid: tuple[int, ...] = ()
    text: int = 1

    @property
    def count(self) -> int:
        """So many registers."""
        return _SIZES.get(self.type, self.text)

    def value(self, words: Sequence[int]) -> Number | None:
        """The value of these registers; None if they have none."""
        plain = turned(words, self.swap)
        data = b"".join(word.to_bytes(2, "big") for word in plain)
        if self.type == "string":
            return data.split(b"\0")[0].decode().rstrip(" ")
        number = self._carried(int.from_bytes(data, "big"), data)
        if number is None:
            return None
        return number * Fraction(self.scale) + Fraction(self.offset)

    def _carried(self, whole: int, data: bytes) -> Fraction | None:
        if self.bits is not None:
            first, last = self.bits
            return Fraction(whole >> first & (1 << last + 1 - first) - 1)
        if self.type.startswith("float"):
            (number,) = struct.unpack(">f" if self.type == "float32" else ">d", data)
            return _shortest(number, data) if isfinite(number) else None
        if self.type.startswith("bcd"):
            return Fraction(int(data.hex())) if data.hex().isdecimal() else None
        signed = whole - (1 << 8 * len(data)) if self.type[0] == "i" and data[0] & 0x80 else whole
        return None if signed in self.invalid else Fraction(signed)

    def words(self, value: Number) -> tuple[int, ...] | None:
        """The registers that carry a value; None if it does not fit."""
        data = self._text(value) if isinstance(value, str) else self._data(value)
        if data is None:
            return None
        return turned([int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)], self.swap)

    def _text(self, value: str) -> bytes:
        return value.encode().ljust(2 * self.text, b"\0")

    def _data(self, value: Fraction) -> bytes | None:
        number, size = (value - Fraction(self.offset)) / Fraction(self.scale), 2 * self.count
        if self.type.startswith("float"):
            try:
                return struct.pack(">f" if self.type == "float32" else ">d", float(number))
            except OverflowError:
                return None
        whole = rounded(number)
        if self.type.startswith("bcd"):
            return bytes.fromhex(f"{whole:0{2 * size}d}") if 0 <= whole < 10 ** (2 * size) else None
        try:
            return whole.to_bytes(size, "big", signed=self.type[0] == "i")
        except OverflowError:
            return None


def _shortest(number: float, data: bytes) -> Fraction:
    """The decimal with the fewest digits that gives these bytes."""
    layout = ">f" if len(data) == struct.calcsize("f") else ">d"
    texts = (f"{number:.{digits}g}" for digits in range(1, 18))
    return next(Fraction(text) for text in texts if _packed(layout, text) == data)


def _packed(layout: str, text: str) -> bytes:
    try:
        return struct.pack(layout, float(text))
    except OverflowError:
        return b""
