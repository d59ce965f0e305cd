"""Requests and responses in words: what is asked, at which addresses, and the values."""

from typing import Final

from gateway.errors import ExceptionCode, RequestError
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import RequestPdu, Span, parse_request
from gateway.registers.bits import unpack_bits
from gateway.registers.items import has_bits
from gateway.registers.reference import reference

#: So many values are shown; the rest is counted.
_MOST: Final = 16


def request_in_words(pdu: bytes) -> str:
    """What a request asks for: `read holding 0-1 (40001-40002)`."""
    asked = _parsed(pdu)
    if asked is None:
        return f"{_function(pdu[0])}: {pdu.hex(' ').upper()}"
    parts = []
    if asked.write is not None:
        parts.append(f"write {_span(asked.write)}{_written(asked)}")
    if asked.read is not None:
        parts.append(f"read {_span(asked.read)}")
    return ", ".join(parts) or f"{_function(pdu[0])}{_rest(pdu)}"


def response_in_words(request: bytes, response: bytes) -> str:
    """What a response says to a request: its values, or which exception."""
    if response[0] & EXCEPTION_BIT:
        return exception_in_words(response[1])
    asked = _parsed(request)
    if asked is None:
        return f"{_function(response[0])}: {response.hex(' ').upper()}"
    if asked.read is not None:
        return _values(asked.read, response[2:])
    return "written" if asked.write is not None else f"{_function(response[0])}{_rest(response)}"


def exception_in_words(code: int) -> str:
    """An exception code and its name."""
    try:
        return f"exception {code:02X}, {ExceptionCode(code).name.lower().replace('_', ' ')}"
    except ValueError:
        return f"exception {code:02X}"


def frame_in_words(frame: bytes, *, is_request: bool) -> str:
    """A PDU of which it is not known what it answers."""
    if frame[0] & EXCEPTION_BIT and len(frame) > 1:
        return exception_in_words(frame[1])
    return request_in_words(frame) if is_request else f"{_function(frame[0])}: {frame.hex(' ').upper()}"


def _parsed(pdu: bytes) -> RequestPdu | None:
    try:
        return parse_request(pdu)
    except RequestError:
        return None


def _function(code: int) -> str:
    try:
        return f"{code:02} {FunctionCode(code).name.lower().replace('_', ' ')}"
    except ValueError:
        return f"function {code}"


def _rest(pdu: bytes) -> str:
    return f": {pdu[1:].hex(' ').upper()}" if len(pdu) > 1 else ""


def _span(span: Span) -> str:
    first, last = span.start, span.end - 1
    if first == last:
        return f"{span.area} {first} ({reference(span.area, first)})"
    return f"{span.area} {first}-{last} ({reference(span.area, first)}-{reference(span.area, last)})"


def _written(asked: RequestPdu) -> str:
    if asked.write is None or not asked.values:
        is_coil = asked.function == FunctionCode.WRITE_SINGLE_COIL
        return f": {'on' if asked.data[3] else 'off'}" if is_coil else ""
    return f": {_values(asked.write, asked.values)}"


def _values(span: Span, data: bytes) -> str:
    if has_bits(span.area):
        values = list(unpack_bits(data, min(span.count, 8 * len(data))))
    else:
        values = [int.from_bytes(data[at : at + 2]) for at in range(0, len(data), 2)]
    shown = " ".join(map(str, values[:_MOST]))
    return f"{shown} and {len(values) - _MOST} more" if len(values) > _MOST else shown
