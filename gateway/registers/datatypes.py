"""Data types: how registers carry values. The protocol only has words of 16 bits (A 4.3); the rest is convention.

A value takes as many registers as its type needs. Without a swap the first register has the highest word, and the high
byte of each register comes first, as in the specification's own encoding (A 4.2).

| swap  | registers of 0x11223344 |                                                |
|-------|-------------------------|------------------------------------------------|
| none  | 1122 3344               |                                                |
| words | 3344 1122               | the first register has the lowest word         |
| bytes | 2211 4433               | the bytes of each register change places       |
| both  | 4433 2211               | both                                           |
"""

from collections.abc import Mapping
from math import nan
from struct import Struct, error
from typing import Final, Literal, get_args

DataType = Literal[
    "uint16",
    "int16",
    "uint32",
    "int32",
    "uint64",
    "int64",
    "float32",
    "float64",
    "bcd16",
    "bcd32",
    "uint8",
    "int8",
    "bit",
    "string",
]
Swap = Literal["none", "words", "bytes", "both"]
#: A whole number, a floating-point number, or text.
Value = int | float | str

#: Types of a byte, which shares its register with another one: a point says which byte it is.
BYTE_TYPES: Final = ("uint8", "int8")
#: Types of values that have their registers, or their coil, to themselves.
DATA_TYPES: Final[tuple[str, ...]] = tuple(each for each in get_args(DataType) if each not in BYTE_TYPES)
SWAPS: Final[tuple[str, ...]] = get_args(Swap)

_FORMATS: Final[Mapping[str, Struct]] = {
    "uint16": Struct(">H"),
    "int16": Struct(">h"),
    "uint32": Struct(">I"),
    "int32": Struct(">i"),
    "uint64": Struct(">Q"),
    "int64": Struct(">q"),
    "float32": Struct(">f"),
    "float64": Struct(">d"),
    "bcd16": Struct(">H"),
    "bcd32": Struct(">I"),
}
#: The most significant digits that distinguish a float32 from its neighbours.
_DIGITS_OF_FLOAT32: Final = 9
_REGISTER: Final = 2


def registers_of(data_type: str, width: int = _REGISTER) -> int:
    """Compute how many registers of `width` bytes a value takes. Text takes one at least."""
    layout = _FORMATS.get(data_type)
    return 1 if layout is None else max(1, layout.size // width)


def fits_wide(data_type: str) -> bool:
    """Tell whether a value can be in registers of four bytes."""
    return data_type == "string" or registers_of(data_type) > 1


def is_whole(data_type: str) -> bool:
    """Tell whether a type holds whole numbers only."""
    return data_type != "string" and not is_float(data_type)


def is_float(data_type: str) -> bool:
    """Tell whether a type holds floating-point numbers."""
    return data_type in ("float32", "float64")


def bounds(data_type: str, bits: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return the least and the greatest number that fits into a type of whole numbers, or into some `bits` of it.

    These are the first and the last one. A byte has the bounds of its own type.
    """
    if bits is not None and data_type not in BYTE_TYPES:
        return 0, 2 ** (bits[1] - bits[0] + 1) - 1
    if data_type == "bit":
        return 0, 1
    if data_type.startswith("bcd"):
        return 0, 10 ** (4 * registers_of(data_type)) - 1
    size = 8 if data_type in BYTE_TYPES else 16 * registers_of(data_type)
    return (0, 2**size - 1) if data_type.startswith("u") else (-(2 ** (size - 1)), 2 ** (size - 1) - 1)


def decode(data: bytes, data_type: str, swap: str = "none") -> Value:
    """Decode the bytes of a value's registers, in the order in which a response carries them.

    A float32 is the shortest number that is nearest to it. BCD with a digit above 9 is not a number (NaN). Text ends at
    the first NUL; spaces behind it are dropped, and bytes that are no UTF-8 become �.
    """
    plain = swapped(data, swap)
    if data_type.startswith("bcd"):
        digits = plain.hex()
        return int(digits) if digits.isdecimal() else nan
    if data_type == "string":
        return plain.partition(b"\0")[0].decode("utf-8", "replace").rstrip(" ")
    value: int | float = _FORMATS[data_type].unpack(plain)[0]
    return shortest(value) if data_type == "float32" else value


def encode(value: Value, data_type: str, swap: str = "none", length: int = 1) -> bytes:
    """Make the bytes of the registers that carry `value`; text has `length` registers, filled up with NUL.

    Raises:
        ValueError: the type cannot hold the value.
    """
    if data_type == "string":
        return swapped(_encode_text(str(value), length), swap)
    if isinstance(value, str):
        raise ValueError(f'"{value}" is text, and {data_type} is a number')  # noqa: TRY004 - one error for all
    if is_whole(data_type):
        least, greatest = bounds(data_type)
        is_fraction = isinstance(value, float) and not value.is_integer()
        if is_fraction or not least <= value <= greatest:
            raise ValueError(f"{value} does not fit into {data_type}: whole numbers from {least} to {greatest}")
        value = int(value)
    if data_type.startswith("bcd"):
        value = int(str(value), 16)
    try:
        return swapped(_FORMATS[data_type].pack(value), swap)
    except (OverflowError, error):
        raise ValueError(f"{value} does not fit into {data_type}") from None


def shortest(value: float) -> float:
    """Find the number with the fewest digits that gives the same float32: the one that `decode` returns.

    Raises:
        OverflowError: no float32 is so large.
    """
    layout = _FORMATS["float32"]
    data = layout.pack(value)
    for digits in range(6, _DIGITS_OF_FLOAT32):
        short = float(f"{value:.{digits}g}")
        if layout.pack(short) == data:
            return short
    return value if value != value else float(f"{value:.{_DIGITS_OF_FLOAT32}g}")  # noqa: PLR0124 - not a number


def swapped(data: bytes, swap: str) -> bytes:
    """Swap the bytes of registers, or swap them back."""
    words = [data[at : at + _REGISTER] for at in range(0, len(data), _REGISTER)]
    if swap in ("words", "both"):
        words.reverse()
    if swap in ("bytes", "both"):
        words = [word[::-1] for word in words]
    return b"".join(words)


def _encode_text(text: str, length: int) -> bytes:
    try:
        data = text.encode()
    except UnicodeEncodeError as error:  # JSON may name half of a pair
        raise ValueError(f"text cannot have U+{ord(text[error.start]):04X} in it, which is no character") from None
    size = _REGISTER * length
    if len(data) > size:
        raise ValueError(f'"{text}" has {len(data)} bytes, and {length} registers hold {size}')
    if "\0" in text:
        raise ValueError("text cannot have a NUL in it")
    return data.ljust(size, b"\0")
