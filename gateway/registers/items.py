"""Items, that is coils and registers: their reference numbers, the requests that read and write them, the responses.

Items are bytes: two for a register, as in a response, and one for a coil or an input, 0 or 1.
"""

from collections.abc import Container, Mapping
from typing import Final, Literal

from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.functions import FUNCTIONS, READERS
from gateway.modbus.pdu import Span

#: The functions that write: 05 or 06 for one item and 15 or 16 for several, or always the ones or the others.
WriteFunction = Literal["auto", "single", "multiple"]

#: The bytes of a register (A 4.3) and of a wide one, and the most wide ones in one read and in one write: 248 bytes of
#: values, and 244.
REGISTER: Final = 2
WIDE_REGISTER: Final = 4
MOST_WIDE: Final = 62
MOST_WIDE_WRITTEN: Final = 61

_ON: Final = b"\xff\0"
_OFF: Final = b"\0\0"


def _writers(single: FunctionCode, several: FunctionCode) -> tuple[FunctionCode, FunctionCode, int]:
    items = FUNCTIONS[several].writes
    return single, several, items.most if items else 0


#: The functions that write one item and several, and the most of these in one request.
WRITERS: Final[Mapping[Area, tuple[FunctionCode, FunctionCode, int]]] = {
    Area.COILS: _writers(FunctionCode.WRITE_SINGLE_COIL, FunctionCode.WRITE_MULTIPLE_COILS),
    Area.HOLDING: _writers(FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.WRITE_MULTIPLE_REGISTERS),
}

_BITS: Final = frozenset({Area.COILS, Area.DISCRETE})
_AS_DIGIT: Final = bytes([ord("0"), ord("1")]) + bytes(254)
_AS_BIT: Final = bytes.maketrans(b"01", b"\0\1")

#: The digit with which the reference numbers of each area begin.
DIGITS: Final[Mapping[Area, str]] = {Area.COILS: "0", Area.DISCRETE: "1", Area.INPUT: "3", Area.HOLDING: "4"}

#: The first address of an area in manuals that count addresses so too.
MANUAL_BASES: Final[Mapping[Area, int]] = {Area.HOLDING: 40001, Area.INPUT: 30001, Area.DISCRETE: 10001}


def has_bits(area: Area) -> bool:
    """Tell whether the items of an area are single bits."""
    return area in _BITS


def usual_type(area: Area, width: int = REGISTER) -> str:
    """Name the type that values have unless another one is said."""
    return "bit" if has_bits(area) else "uint32" if width > REGISTER else "uint16"


def read_request(span: Span) -> bytes:
    """Make the request PDU that reads a span."""
    function, _ = READERS[span.area]
    return bytes((function, *span.start.to_bytes(2, "big"), *span.count.to_bytes(2, "big")))


def items_read(span: Span, response: bytes, width: int = REGISTER) -> bytes:
    """Take the items out of a normal response to a read of `span`, whose registers have `width` bytes.

    Raises:
        ValueError: the response has another length.
    """
    data = response[2:]
    needed = (span.count + 7) // 8 if has_bits(span.area) else width * span.count
    if len(data) != needed:
        raise ValueError(f"the response carries {len(data)} bytes, and {needed} were asked for")
    return unpack_bits(data, span.count) if has_bits(span.area) else data


def write_function(
    area: Area,
    count: int,
    functions: Container[int] | None = None,
    *,
    how: WriteFunction = "auto",
    width: int = REGISTER,
) -> FunctionCode:
    """Choose the function that writes so many coils or holding registers of a unit that knows `functions` (None: all).

    One item is written with 05 or 06, unless the unit knows only 15 or 16; several with 15 or 16, as wide ones always.
    """
    single, several, _ = WRITERS[area]
    if count > 1 or width > REGISTER or how == "multiple":
        return several
    only_several = functions is not None and single not in functions and several in functions
    return several if only_several and how == "auto" else single


def most_written(area: Area, limits: Mapping[int, int], width: int = REGISTER) -> int:
    """Find the most coils or holding registers that one request writes; `limits` is the most of a function."""
    _, several, most = WRITERS[area]
    return min(MOST_WIDE_WRITTEN if width > REGISTER else most, limits.get(several, most))


def write_request(
    area: Area,
    start: int,
    items: bytes,
    functions: Container[int] | None = None,
    *,
    how: WriteFunction = "auto",
    width: int = REGISTER,
) -> bytes:
    """Make the request PDU that writes items from `start` on, with the function that `write_function` names."""
    count = len(items) if has_bits(area) else len(items) // width
    function = write_function(area, count, functions, how=how, width=width)
    if function == WRITERS[area][0]:
        value = items if not has_bits(area) else _ON if items[0] else _OFF
        return bytes((function, *start.to_bytes(2, "big"), *value))
    data = pack_bits(items) if has_bits(area) else items
    return bytes((function, *start.to_bytes(2, "big"), *count.to_bytes(2, "big"), len(data), *data))


def pack_bits(bits: bytes) -> bytes:
    """Pack coils or inputs, one byte of 0 or 1 each, eight in a byte, the first one lowest (A 6.1)."""
    size = (len(bits) + 7) // 8
    return int(bits[::-1].translate(_AS_DIGIT) or b"0", 2).to_bytes(size, "little")


def unpack_bits(data: bytes, count: int) -> bytes:
    """Unpack the first `count` bits of `data`, one 0 or 1 each: the opposite of `pack_bits`."""
    digits = format(int.from_bytes(data, "little"), f"0{len(data) * 8}b").encode()
    return digits[::-1][:count].translate(_AS_BIT)


def reference(area: Area, address: int) -> str:
    """Make the number of an item in manuals: a digit for the area, then a number from 1.

    Holding 107 of the protocol, which counts from 0, is 40108; holding 9999 is 410000.
    """
    return f"{DIGITS[area]}{address + 1:04}"


def place_of(number: str) -> tuple[Area, int] | None:
    """Find the area and the protocol address of a reference number with five or six digits; None if it is none."""
    area = next((area for area, digit in DIGITS.items() if number.startswith(digit)), None)
    if area is None or not number.isdecimal() or len(number) not in (5, 6) or not 1 <= int(number[1:]) <= 65536:
        return None
    return area, int(number[1:]) - 1
