"""Requests and responses in words: what is asked, at which addresses, and the values.

`word` translates an English text into another language.
"""

from collections.abc import Callable, Mapping
from typing import Final

from gateway.errors import ExceptionCode, RequestError
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import RequestPdu, Span, parse_sent
from gateway.registers.items import REGISTER, WIDE_REGISTER, has_bits, reference, unpack_bits

#: The names of the functions and exceptions in the standard.
FUNCTIONS: Final[Mapping[int, str]] = {
    1: "read coils",
    2: "read discrete inputs",
    3: "read holding registers",
    4: "read input registers",
    5: "write single coil",
    6: "write single register",
    7: "read exception status",
    8: "diagnostics",
    11: "get comm event counter",
    12: "get comm event log",
    15: "write multiple coils",
    16: "write multiple registers",
    17: "report server id",
    20: "read file record",
    21: "write file record",
    22: "mask write register",
    23: "read write multiple registers",
    24: "read fifo queue",
    43: "encapsulated interface",
}
EXCEPTIONS: Final[Mapping[int, str]] = {each.value: each.name.lower().replace("_", " ") for each in ExceptionCode}

#: This many values are shown; the rest is counted.
_MOST: Final = 16

Word = Callable[[str], str]


def request_in_words(pdu: bytes, word: Word = str) -> str:
    """Describe what a request asks for: `read holding 0-1 (40001-40002)`."""
    asked = _parsed(pdu)
    if asked is None:
        return f"{_function(pdu[0], word)}: {pdu.hex(' ').upper()}"
    parts = []
    if asked.write is not None:
        parts.append(_span(word("write %(area)s %(addresses)s"), asked.write, word) + _written(asked, word))
    if asked.read is not None:
        parts.append(_span(word("read %(area)s %(addresses)s"), asked.read, word))
    return ", ".join(parts) or f"{_function(pdu[0], word)}{_rest(pdu)}"


def response_in_words(request: bytes, response: bytes, word: Word = str) -> str:
    """Describe what a response says to a request: its values, or which exception."""
    if response[0] & EXCEPTION_BIT:
        return exception_in_words(response[1], word)
    asked = _parsed(request)
    if asked is None:
        return f"{_function(response[0], word)}: {response.hex(' ').upper()}"
    if asked.read is not None:
        return _values(asked.read, response[2:], word)
    return word("written") if asked.write is not None else f"{_function(response[0], word)}{_rest(response)}"


def exception_in_words(code: int, word: Word = str) -> str:
    """Name an exception, with its code."""
    told = word("exception %(code)s") % {"code": f"{code:02X}"}
    return f"{told}, {word(EXCEPTIONS[code])}" if code in EXCEPTIONS else told


def frame_in_words(frame: bytes, *, is_request: bool, word: Word = str) -> str:
    """Describe a PDU of which it is not known what it answers."""
    if frame[0] & EXCEPTION_BIT and len(frame) > 1:
        return exception_in_words(frame[1], word)
    return request_in_words(frame, word) if is_request else f"{_function(frame[0], word)}: {frame.hex(' ').upper()}"


def _parsed(pdu: bytes) -> RequestPdu | None:
    try:
        return parse_sent(pdu)
    except RequestError:
        return None


def _function(code: int, word: Word) -> str:
    return f"{code:02} {word(FUNCTIONS[code])}" if code in FUNCTIONS else word("function %(code)s") % {"code": code}


def _rest(pdu: bytes) -> str:
    return f": {pdu[1:].hex(' ').upper()}" if len(pdu) > 1 else ""


def _span(text: str, span: Span, word: Word) -> str:
    first, last = span.start, span.end - 1
    if first == last:
        addresses = f"{first} ({reference(span.area, first)})"
    else:
        addresses = f"{first}-{last} ({reference(span.area, first)}-{reference(span.area, last)})"
    return text % {"area": word(span.area), "addresses": addresses}


def _written(asked: RequestPdu, word: Word) -> str:
    if asked.write is None or not asked.values:
        is_coil = asked.function == FunctionCode.WRITE_SINGLE_COIL
        return f": {_coil(asked.data[3:], word)}" if is_coil else ""
    return f": {_values(asked.write, asked.values, word)}"


def _coil(value: bytes, word: Word) -> str:
    """Write the value of function 05. Some devices know others than on and off."""
    return {b"\xff\0": word("on"), b"\0\0": word("off")}.get(value, value.hex().upper())


def _values(span: Span, data: bytes, word: Word) -> str:
    if has_bits(span.area):
        values = list(unpack_bits(data, min(span.count, 8 * len(data))))
    else:
        size = WIDE_REGISTER if len(data) == WIDE_REGISTER * span.count else REGISTER
        values = [int.from_bytes(data[at : at + size]) for at in range(0, len(data), size)]
    shown = " ".join(map(str, values[:_MOST]))
    if len(values) <= _MOST:
        return shown
    return word("%(values)s and %(count)s more") % {"values": shown, "count": len(values) - _MOST}
