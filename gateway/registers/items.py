"""Request PDUs that read and write items, and the items in responses.

Items are bytes: two for a register, as in a response, and one for a coil or an input, 0 or 1.
"""

from collections.abc import Container, Mapping
from typing import Final

from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.functions import FUNCTIONS, READERS
from gateway.modbus.pdu import Span
from gateway.registers.bits import pack_bits, unpack_bits

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


def has_bits(area: Area) -> bool:
    """Whether the items of an area are single bits."""
    return area in _BITS


def read_request(span: Span) -> bytes:
    """The request PDU that reads a span."""
    function, _ = READERS[span.area]
    return bytes((function, *span.start.to_bytes(2, "big"), *span.count.to_bytes(2, "big")))


def items_read(span: Span, response: bytes) -> bytes:
    """The items in a normal response to a read of `span`.

    Raises:
        ValueError: the response is not that long.
    """
    data = response[2:]
    needed = (span.count + 7) // 8 if has_bits(span.area) else 2 * span.count
    if len(data) < needed:
        raise ValueError(f"the response carries {len(data)} bytes, and {needed} were asked for")
    return unpack_bits(data, span.count) if has_bits(span.area) else data[:needed]


def write_function(
    area: Area, count: int, functions: Container[int] | None = None, *, multiple: bool = False
) -> FunctionCode:
    """The function that writes this many coils or holding registers of a unit that knows `functions` (None: all).

    One item is written with 05 or 06, unless `multiple` or the unit knows only 15 or 16; several with 15 or 16.
    """
    single, several, _ = WRITERS[area]
    only_several = functions is not None and single not in functions and several in functions
    return several if count > 1 or multiple or only_several else single


def most_written(area: Area, limits: Mapping[int, int]) -> int:
    """The most coils or holding registers that one request writes; `limits` is the most of a function."""
    _, several, most = WRITERS[area]
    return min(most, limits.get(several, most))


def write_request(
    area: Area, start: int, items: bytes, functions: Container[int] | None = None, *, multiple: bool = False
) -> bytes:
    """The request PDU that writes items from `start` on, with the function that `write_function` names."""
    count = len(items) if has_bits(area) else len(items) // 2
    function = write_function(area, count, functions, multiple=multiple)
    if function == WRITERS[area][0]:
        value = items if not has_bits(area) else _ON if items[0] else _OFF
        return bytes((function, *start.to_bytes(2, "big"), *value))
    data = pack_bits(items) if has_bits(area) else items
    return bytes((function, *start.to_bytes(2, "big"), *count.to_bytes(2, "big"), len(data), *data))
