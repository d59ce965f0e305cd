"""Guesses which framing unexpected bytes have. Needed only after an error."""

from typing import Final, Literal

from gateway.modbus.ascii import END, decode
from gateway.modbus.functions import request_size, response_size
from gateway.modbus.rtu import crc_fits

#: The framings, as in messages.
Framing = Literal["Modbus TCP", "RTU", "ASCII"]

#: The URL scheme of each framing.
_SCHEMES: Final[dict[Framing, str]] = {"Modbus TCP": "tcp", "RTU": "rtu+tcp", "ASCII": "ascii+tcp"}
#: The size of a TCP ADU before its PDU; that of an RTU frame without its PDU.
_HEADER: Final = 7
_OVERHEAD: Final = 3
#: A shorter request or response proves too little.
_SHORTEST_PDU: Final = 2


def looks_like(data: bytes) -> Framing | None:
    """Find a framing in which `data` begins with a whole frame; None if there is none."""
    if _is_tcp(data):
        return "Modbus TCP"
    if decode(data[: data.find(END) + len(END)]) is not None:
        return "ASCII"
    return "RTU" if _is_rtu(data) else None


def likeness(data: bytes, own: Framing) -> str:
    """Return the end of a message that says so if `data` begins with a frame of another framing than `own`."""
    framing = looks_like(data)
    return "" if framing in (None, own) else f": this looks like {framing}, which {_SCHEMES[framing]}:// is for"


def _is_tcp(data: bytes) -> bool:
    """Tell whether `data` begins with a header with protocol identifier 0 and a PDU that fits its function."""
    if len(data) < _HEADER + _SHORTEST_PDU or data[2:4] != b"\0\0":
        return False
    size = 6 + int.from_bytes(data[4:6])
    if not _HEADER + _SHORTEST_PDU <= size <= len(data):
        return False  # compiled, a slice that ends before its start is an error
    pdu = data[_HEADER:size]
    return len(pdu) in (request_size(pdu), response_size(pdu))


def _is_rtu(data: bytes) -> bool:
    if len(data) <= _OVERHEAD:
        return False
    sizes = {size_of(data[1:]) for size_of in (request_size, response_size)}
    return any(_SHORTEST_PDU <= size <= len(data) - _OVERHEAD and crc_fits(data[: size + _OVERHEAD]) for size in sizes)
