"""Diagnostics (functions 08, 11 and 12) and identification (17 and 43/14) of an image.

Diagnostics are an echo, counters, and a log of the last events (A 6.8, 6.9, 6.10), meant for a unit on a serial line.
An image has no line: a request reaches it complete or not at all. So the counters count its requests, and those of
characters, busy units and negative acknowledgements stay 0. An image has no restart and no listen-only mode.
"""

from collections import deque
from struct import Struct
from typing import Final

from gateway.errors import IllegalAddress, IllegalFunction
from gateway.modbus.codes import (
    BROADCAST_UNIT,
    CLEAR_COUNTERS,
    CLEAR_OVERRUN_COUNTER,
    COUNTERS,
    DEVICE_IDENTIFICATION,
    MAX_PDU,
    ONE_OBJECT,
    RETURN_QUERY_DATA,
    FunctionCode,
)
from gateway.modbus.functions import MOST_EVENTS
from gateway.modbus.shapes import need
from gateway.request import Request
from gateway.version import __version__

#: Sub-functions of counters. An image counts 0B and 0D to 0F; the others of 0B-12 are 0.
BUS_MESSAGES: Final = 0x0B
COMMUNICATION_ERRORS: Final = 0x0C
EXCEPTIONS: Final = 0x0D
SERVER_MESSAGES: Final = 0x0E
NO_RESPONSES: Final = 0x0F
BUS_BUSY: Final = 0x11

_WORD: Final = Struct(">H")
_COUNTER: Final = Struct(">BHH")
_LOG: Final = Struct(">BBHHH")

#: No program command is ever being processed (A 6.9).
_READY: Final = 0x0000

#: Reading the event counter is not an event (A 6.9).
_NO_EVENTS: Final = frozenset({FunctionCode.GET_COMM_EVENT_COUNTER, FunctionCode.GET_COMM_EVENT_LOG})

#: Bits of the event bytes (A 6.10): a request was received, perhaps as a broadcast; it was processed.
_RECEIVED: Final = 0x80
_AS_BROADCAST: Final = 0x40
_PROCESSED: Final = 0x40
_EXCEPTION_BITS: Final = {1: 0x01, 2: 0x01, 3: 0x01, 4: 0x02, 5: 0x04, 6: 0x04}


class Diagnostics:
    """Counters of an image, which wrap at 65536, and its event log."""

    def __init__(self) -> None:
        self._log: deque[int] = deque(maxlen=MOST_EVENTS)
        self._clear()

    def _clear(self) -> None:
        self._messages = 0
        self._exceptions = 0
        self._unanswered = 0
        self._events = 0

    def received(self, request: Request) -> None:
        """Count a request that was received."""
        self._messages += 1
        is_broadcast = request.unit == BROADCAST_UNIT
        self._unanswered += is_broadcast
        self._log.appendleft(_RECEIVED | _AS_BROADCAST if is_broadcast else _RECEIVED)

    def done(self, request: Request) -> None:
        """Note that the request was executed."""
        self._events += request.pdu[0] not in _NO_EVENTS
        self._log.appendleft(_PROCESSED)

    def refused(self, request: Request, code: int) -> None:
        """Note that the request gets an exception; as a broadcast it gets none."""
        if request.unit == BROADCAST_UNIT:
            self._log.appendleft(_PROCESSED)
        else:
            self._exceptions += 1
            self._log.appendleft(_PROCESSED | _EXCEPTION_BITS.get(code, 0))

    def perform(self, pdu: bytes) -> bytes:
        """Answer function 08: echo, clear, or a counter.

        Raises:
            IllegalFunction: it is another sub-function.
            IllegalValue: the data is not 0000.
        """
        asked = int.from_bytes(pdu[1:3], "big")
        if asked == RETURN_QUERY_DATA:
            return pdu
        if asked not in COUNTERS and asked not in (CLEAR_COUNTERS, CLEAR_OVERRUN_COUNTER):
            raise IllegalFunction(f"an image has no sub-function {asked} of function 8")
        need(pdu[3:] == b"\0\0", pdu, "the data must be 0000")
        if asked in COUNTERS:
            return pdu[:3] + _WORD.pack(self.counter(asked))
        if asked == CLEAR_COUNTERS:
            self._clear()
        return pdu

    def counter(self, asked: int) -> int:
        """Return the counter of sub-function `asked` of 08. The present request is counted."""
        counters = {
            BUS_MESSAGES: self._messages,
            EXCEPTIONS: self._exceptions,
            SERVER_MESSAGES: self._messages,
            NO_RESPONSES: self._unanswered,
        }
        return counters.get(asked, 0) & 0xFFFF

    def event_counter(self, pdu: bytes) -> bytes:
        """Answer function 11: the number of executed requests."""
        return _COUNTER.pack(pdu[0], _READY, self._events & 0xFFFF)

    def event_log(self, pdu: bytes) -> bytes:
        """Answer function 12: the event counter, the message count, and the last events, the latest first."""
        size = _LOG.size - 2 + len(self._log)
        return _LOG.pack(pdu[0], size, _READY, self._events & 0xFFFF, self.counter(BUS_MESSAGES)) + bytes(self._log)


VENDOR: Final = "modbus-gateway"
PRODUCT: Final = "register image"

#: Identifiers of objects (A 6.21). The first three are the basic ones.
_VENDOR_NAME, _PRODUCT_CODE, _REVISION, _APPLICATION_NAME = 0, 1, 2, 6
#: The code for the basic objects only.
_BASIC: Final = 1
#: Conformity level: basic and regular objects, as a stream and one by one.
_REGULAR: Final = 0x82
#: More objects follow.
_MORE: Final = 0xFF

#: Bytes of an identification before its first object, and of an object before its value.
_HEAD_SIZE: Final = 7
_OBJECT_HEAD_SIZE: Final = 2
#: The longest value that fits into one response.
_LONGEST_VALUE: Final = MAX_PDU - _HEAD_SIZE - _OBJECT_HEAD_SIZE

#: An image always runs.
_RUNNING: Final = b"\xff"


class Identity:
    """The identification of an image. Its name is sent in ASCII, and shortened to fit into a response."""

    def __init__(self, name: str, product: str = PRODUCT) -> None:
        texts = {_VENDOR_NAME: VENDOR, _PRODUCT_CODE: product, _REVISION: __version__, _APPLICATION_NAME: name}
        self._objects = {number: text.encode("ascii", "replace")[:_LONGEST_VALUE] for number, text in texts.items()}

    def report(self, pdu: bytes) -> bytes:
        """Answer function 17: its name, and that it is running."""
        data = self._objects[_APPLICATION_NAME] + _RUNNING
        return bytes((pdu[0], len(data))) + data

    def identify(self, pdu: bytes) -> bytes:
        """Answer function 43: its objects from the requested one on, as many as fit.

        Raises:
            IllegalFunction: the type is not 14.
            IllegalAddress: there is no such single object.
        """
        if pdu[1] != DEVICE_IDENTIFICATION:
            raise IllegalFunction(f"an image has no type {pdu[1]} of function 43")
        code, first = pdu[2], pdu[3]
        if code != ONE_OBJECT:
            return self._stream(pdu, self._asked(code, first))
        if first not in self._objects:
            raise IllegalAddress(f"an image has no object {first}")
        return self._stream(pdu, [first])

    def _asked(self, code: int, first: int) -> list[int]:
        """Return the objects from `first` on; all of them if there is no such object (A 6.21)."""
        numbers = [number for number in self._objects if code != _BASIC or number <= _REVISION]
        return numbers[numbers.index(first) :] if first in numbers else numbers

    def _stream(self, pdu: bytes, numbers: list[int]) -> bytes:
        count, data = 0, b""
        for number in numbers:
            value = self._objects[number]
            if _HEAD_SIZE + len(data) + _OBJECT_HEAD_SIZE + len(value) > MAX_PDU:
                return pdu[:3] + bytes((_REGULAR, _MORE, number, count)) + data
            data += bytes((number, len(value))) + value
            count += 1
        return pdu[:3] + bytes((_REGULAR, 0, 0, count)) + data
