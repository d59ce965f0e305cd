"""What each function code means that is about the tables (A 6): the change it makes to them, and the response.

All of them have one shape. Once structure and addresses are checked, items are written if the function writes, **then**
items are read if it reads (function 23 does both, in this order: A 6.17). The response is the head that the request
foretold, with the read items behind it.
"""

from collections.abc import Callable
from struct import Struct
from typing import Final

from gateway.images.tables import Table, Tables
from gateway.modbus.codes import FunctionCode
from gateway.modbus.pdu import RequestPdu, Span

_WORD = Struct(">H")
_MASKS = Struct(">3xHH")


def perform(tables: Tables, asked: RequestPdu) -> bytes:
    """Do what a checked request asks for, and give the response PDU."""
    if asked.write is not None:
        _WRITERS[asked.function](tables[asked.write.area], asked.write, asked.data)
    if asked.read is None:
        return asked.response_head
    return asked.response_head + tables[asked.read.area].read(asked.read)


def _write_coil(table: Table, span: Span, pdu: bytes) -> None:
    """FF00 is on, 0000 off (A 6.5)."""
    table.write(span, b"\1" if pdu[3] else b"\0")


def _write_register(table: Table, span: Span, pdu: bytes) -> None:
    """The value stands behind the address (A 6.6)."""
    table.write(span, pdu[3:])


def _write_multiple(table: Table, span: Span, pdu: bytes) -> None:
    """The values stand behind address, quantity and byte count (A 6.11, 6.12)."""
    table.write(span, pdu[6:])


def _mask_register(table: Table, span: Span, pdu: bytes) -> None:
    """(current AND and_mask) OR (or_mask AND NOT and_mask) (A 6.16)."""
    (current,) = _WORD.unpack(table.read(span))
    and_mask, or_mask = _MASKS.unpack(pdu)
    table.write(span, _WORD.pack((current & and_mask) | (or_mask & ~and_mask)))


def _write_before_reading(table: Table, span: Span, pdu: bytes) -> None:
    """The values stand behind both addresses, both quantities and the byte count (A 6.17)."""
    table.write(span, pdu[10:])


_READING: Final = frozenset(
    {
        FunctionCode.READ_COILS,
        FunctionCode.READ_DISCRETE_INPUTS,
        FunctionCode.READ_HOLDING_REGISTERS,
        FunctionCode.READ_INPUT_REGISTERS,
    }
)

_WRITERS: Final[dict[int, Callable[[Table, Span, bytes], None]]] = {
    FunctionCode.WRITE_SINGLE_COIL: _write_coil,
    FunctionCode.WRITE_SINGLE_REGISTER: _write_register,
    FunctionCode.WRITE_MULTIPLE_COILS: _write_multiple,
    FunctionCode.WRITE_MULTIPLE_REGISTERS: _write_multiple,
    FunctionCode.MASK_WRITE_REGISTER: _mask_register,
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: _write_before_reading,
}

#: The functions that are about the tables.
FUNCTIONS: Final[frozenset[int]] = _READING | _WRITERS.keys()
