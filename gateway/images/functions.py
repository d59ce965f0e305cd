"""The functions that read and write the tables (A 6): what each one changes, and its response.

All of them work alike. After structure and addresses are checked, items are written if the function writes, **then**
read if it reads (function 23 does both, in this order: A 6.17). The response is the header that follows from the
request, and then the items that were read.
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
    """Execute a checked request; returns the response PDU."""
    if asked.write is not None:
        _WRITERS.get(asked.function, _write)(tables[asked.write.area], asked.write, asked)
    if asked.read is None:
        return asked.response_head
    return asked.response_head + tables[asked.read.area].read(asked.read)


def _write(table: Table, span: Span, asked: RequestPdu) -> None:
    """Write the values of the request."""
    table.write(span, asked.values)


def _write_coil(table: Table, span: Span, asked: RequestPdu) -> None:
    """FF00 is on, 0000 off (A 6.5)."""
    table.write(span, b"\1" if asked.data[3] else b"\0")


def _mask_register(table: Table, span: Span, asked: RequestPdu) -> None:
    """(current AND and_mask) OR (or_mask AND NOT and_mask) (A 6.16)."""
    (current,) = _WORD.unpack(table.read(span))
    and_mask, or_mask = _MASKS.unpack(asked.data)
    table.write(span, _WORD.pack((current & and_mask) | (or_mask & ~and_mask)))


_WRITERS: Final[dict[int, Callable[[Table, Span, RequestPdu], None]]] = {
    FunctionCode.WRITE_SINGLE_COIL: _write_coil,
    FunctionCode.MASK_WRITE_REGISTER: _mask_register,
}
