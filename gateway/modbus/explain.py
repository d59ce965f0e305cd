"""Explanations of what came in place of a response. Needed only when there was no response."""

from typing import Final, Literal

from gateway.modbus import mbap
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import Area
from gateway.modbus.codes import FunctionCode as Code
from gateway.modbus.framings import Framing, looks_like
from gateway.modbus.functions import response_size
from gateway.modbus.pdu import RequestPdu
from gateway.modbus.rtu import SHORTEST, crc_fits

Mode = Literal["rtu", "ascii", "tcp"]

#: The reason why a response with this transaction identifier is not the one to a request.
OTHER_IDENTIFIER: Final = "intact, but its transaction identifier {:04X} is not that of the request"
#: The same of one from this unit.
OTHER_UNIT: Final = "intact, but from unit {}"
#: The framing of each mode, and the remedy for a device that uses another one.
_NAMES: Final[dict[Mode, Framing]] = {"rtu": "RTU", "ascii": "ASCII", "tcp": "Modbus TCP"}
_REMEDIES: Final[dict[Framing, str]] = {
    "RTU": 'mode = "rtu", or rtu+tcp:// in port, is for that',
    "ASCII": 'mode = "ascii", or ascii+tcp:// in port, is for that',
    "Modbus TCP": "[[upstream]] is for that",
}
#: Functions whose responses repeat address and value; address and quantity.
_REPEATING: Final = (Code.WRITE_SINGLE_COIL, Code.WRITE_SINGLE_REGISTER, Code.MASK_WRITE_REGISTER)
_CONFIRMING: Final = (Code.WRITE_MULTIPLE_COILS, Code.WRITE_MULTIPLE_REGISTERS)


def explain(asked: RequestPdu, unit: int | None, heard: bytes, mode: Mode) -> str:
    """Say why `heard` is not the response of `unit`, or of any if None, to `asked`; empty if it proves nothing.

    On a line, frames of other units and functions prove nothing: they may be for others.
    """
    if mode == "tcp":
        return _explain_adu(asked, unit, mbap.decode(heard))
    frame = _only_frame(heard, mode)
    if frame is not None:
        return explain_pdu(asked, frame[1]) if unit in (None, frame[0]) else ""
    framing = looks_like(heard)
    return "" if framing in (None, _NAMES[mode]) else f"this looks like {framing}: {_REMEDIES[framing]}"


def explain_pdu(asked: RequestPdu, pdu: bytes) -> str:
    """Say why the PDU of an intact frame with the same function is not the response; else return an empty text."""
    data = asked.data
    if pdu[0] != asked.function or response_size(pdu) not in (0, len(pdu)) or asked.accepts(pdu):
        return ""
    if asked.read is not None:
        came, expected = len(pdu) - 2, (asked.response_size or 2) - 2
        is_double = came == 2 * expected and asked.read.area in (Area.HOLDING, Area.INPUT)
        hint = " (32-bit registers?)" if is_double else ""
        return f"intact, {came} data bytes where {expected} were expected{hint}"
    if asked.function in _REPEATING and pdu[1:3] == data[1:3]:
        hint = " (limited by the device)" if asked.function == Code.WRITE_SINGLE_REGISTER else ""
        return f"echoed {_hex(pdu[3:])}, sent {_hex(data[3:])}{hint}"
    if asked.function in _CONFIRMING:
        return f"intact, confirms {_items(pdu)} where {_items(data)} were sent"
    return ""


def _explain_adu(asked: RequestPdu, unit: int | None, adu: mbap.TcpFrame | None) -> str:
    if adu is None:
        return ""
    if adu.unit != unit and adu.unit not in mbap.NO_UNIT:
        return OTHER_UNIT.format(adu.unit)
    if asked.accepts(adu.pdu):
        return OTHER_IDENTIFIER.format(adu.transaction)
    function = adu.pdu[0] & 0x7F
    unfit = "with a wrong size or address" if function == asked.function else f"of function {function:02}"
    return explain_pdu(asked, adu.pdu) or f"intact, but {unfit}"


def _only_frame(heard: bytes, mode: Mode) -> tuple[int, bytes] | None:
    """Return unit and PDU, if nothing else was heard."""
    if mode == "ascii":
        framer = AsciiFramer()
        frames = framer.received(heard, 0.0)
        return (frames[0].unit, frames[0].pdu) if len(frames) == 1 and not framer.behind else None
    return (heard[0], heard[1:-2]) if len(heard) >= SHORTEST and crc_fits(heard) else None


def _hex(data: bytes) -> str:
    return data.hex().upper()


def _items(pdu: bytes) -> str:
    """Format the quantity and the address behind the function code."""
    return f"{int.from_bytes(pdu[3:5])} from {int.from_bytes(pdu[1:3])} on"
