"""Request PDUs that read and write items, and the items in responses.

Items are bytes: two for a register, as in a response, and one for a coil or an input, 0 or 1.
"""

from collections.abc import Mapping
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


def write_request(area: Area, start: int, items: bytes, *, multiple: bool = False) -> bytes:
    """The request PDU that writes items from `start` on: to coils or holding registers.

    A single item is written with function 05 or 06, unless `multiple`; several with 15 or 16.
    """
    single_function, multiple_function, _ = WRITERS[area]
    count = len(items) if has_bits(area) else len(items) // 2
    if count == 1 and not multiple:
        value = items if not has_bits(area) else _ON if items[0] else _OFF
        return bytes((single_function, *start.to_bytes(2, "big"), *value))
    data = pack_bits(items) if has_bits(area) else items
    return bytes((multiple_function, *start.to_bytes(2, "big"), *count.to_bytes(2, "big"), len(data), *data))
