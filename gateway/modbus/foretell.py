"""The size of a PDU, foretold from its first bytes: for those who cut a stream without knowing what was asked.

Both functions answer with the number of bytes that must be there before more can be said. Once that many are there, it
is the size of the PDU. 0 means that only silence ends the frame: the function is not known, or has no fixed shape.
"""

from collections.abc import Callable
from typing import Final

from gateway.modbus.codes import DEVICE_IDENTIFICATION, EXCEPTION_BIT, FunctionCode

#: Functions whose request has a fixed size.
_REQUEST_SIZES: Final = {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5, 7: 1, 11: 1, 12: 1, 17: 1, 22: 7, 24: 3}
#: Functions whose request carries a byte count, and where.
_REQUEST_BYTE_COUNTS: Final = {15: 5, 16: 5, 20: 1, 21: 1, 23: 9}
#: Functions whose response has a fixed size.
_RESPONSE_SIZES: Final = {5: 5, 6: 5, 7: 2, 11: 5, 15: 5, 16: 5, 22: 7}
#: Functions whose response carries a byte count behind the function code.
_COUNTED_RESPONSES: Final = frozenset({1, 2, 3, 4, 12, 17, 20, 21, 23})

#: Sub-functions of 08 with one word of data in request and response (A 6.8.1). 0 echoes as much as it is sent.
ONE_WORD_DIAGNOSTICS: Final = frozenset({1, 2, 3, 4, *range(0x0A, 0x13), 0x14})


def request_size(head: bytes) -> int:
    """Size of the request PDU that begins with `head`."""
    if not head:
        return 1
    function = head[0]
    if function in _REQUEST_SHAPES:
        return _REQUEST_SHAPES[function](head)
    at = _REQUEST_BYTE_COUNTS.get(function)
    if at is None:
        return _REQUEST_SIZES.get(function, 0)
    return at + 1 + (head[at] if len(head) > at else 0)


def response_size(head: bytes) -> int:
    """Size of the response PDU, normal or exception, that begins with `head`."""
    if not head:
        return 1
    function = head[0]
    if function & EXCEPTION_BIT:
        return 2
    if function in _COUNTED_RESPONSES:
        return 2 + (head[1] if len(head) > 1 else 0)
    if function in _RESPONSE_SHAPES:
        return _RESPONSE_SHAPES[function](head)
    return _RESPONSE_SIZES.get(function, 0)


def _diagnostics(head: bytes) -> int:
    if len(head) < 3:
        return 3
    return 5 if int.from_bytes(head[1:3], "big") in ONE_WORD_DIAGNOSTICS else 0


def _queue(head: bytes) -> int:
    """The byte count is a word (A 6.18)."""
    return 3 + (int.from_bytes(head[1:3], "big") if len(head) > 2 else 0)


def _identification_request(head: bytes) -> int:
    if len(head) < 2:
        return 2
    return 4 if head[1] == DEVICE_IDENTIFICATION else 0


def _identification(head: bytes) -> int:
    """The number of objects stands in byte 6, then each has its identifier, its length and its value (A 6.21)."""
    if len(head) < 2:
        return 2
    if head[1] != DEVICE_IDENTIFICATION:
        return 0
    size = 7
    for _ in range(head[6] if len(head) > 6 else 0):
        size += 2
        if len(head) < size:
            break
        size += head[size - 1]
    return size


_REQUEST_SHAPES: Final[dict[int, Callable[[bytes], int]]] = {
    FunctionCode.DIAGNOSTICS: _diagnostics,
    FunctionCode.ENCAPSULATED_INTERFACE: _identification_request,
}
_RESPONSE_SHAPES: Final[dict[int, Callable[[bytes], int]]] = {
    FunctionCode.DIAGNOSTICS: _diagnostics,
    FunctionCode.READ_FIFO_QUEUE: _queue,
    FunctionCode.ENCAPSULATED_INTERFACE: _identification,
}
