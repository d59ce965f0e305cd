"""Functions 08, 11 and 12 of an image: an echo, counters, and a log of the last events (A 6.8, 6.9, 6.10).

They are meant for a unit on a serial line. An image has no line: a request reaches it complete or not at all. So the
counters count its requests, and those for characters, busy units and negative acknowledgement stay 0. An image has no
restart and no listen-only mode.
"""

from collections import deque
from struct import Struct
from typing import Final

from gateway.errors import ExceptionCode, IllegalFunction
from gateway.modbus.codes import (
    BROADCAST_UNIT,
    CLEAR_COUNTERS,
    CLEAR_OVERRUN_COUNTER,
    COUNTERS,
    RETURN_QUERY_DATA,
    FunctionCode,
)
from gateway.modbus.functions import MOST_EVENTS
from gateway.modbus.shapes import need
from gateway.request import Request

#: Sub-functions of counters. An image keeps 0B and 0D to 0F; the others of 0B-12 are 0.
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
        """A request was received."""
        self._messages += 1
        is_broadcast = request.unit == BROADCAST_UNIT
        self._unanswered += is_broadcast
        self._log.appendleft(_RECEIVED | _AS_BROADCAST if is_broadcast else _RECEIVED)

    def done(self, request: Request) -> None:
        """The request has been performed."""
        self._events += request.pdu[0] not in _NO_EVENTS
        self._log.appendleft(_PROCESSED)

    def refused(self, request: Request, code: ExceptionCode) -> None:
        """The request gets an exception, which is not sent if it was a broadcast."""
        if request.unit == BROADCAST_UNIT:
            self._log.appendleft(_PROCESSED)
        else:
            self._exceptions += 1
            self._log.appendleft(_PROCESSED | _EXCEPTION_BITS.get(code, 0))

    def perform(self, pdu: bytes) -> bytes:
        """Function 08: echo, clear, or a counter.

        Raises:
            IllegalFunction: another sub-function.
            IllegalDataValue: the data is not 0000.
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
        """The counter that sub-function `asked` of 08 returns. The request that asks for it is counted."""
        counters = {
            BUS_MESSAGES: self._messages,
            EXCEPTIONS: self._exceptions,
            SERVER_MESSAGES: self._messages,
            NO_RESPONSES: self._unanswered,
        }
        return counters.get(asked, 0) & 0xFFFF

    def event_counter(self, pdu: bytes) -> bytes:
        """Function 11: requests that were performed."""
        return _COUNTER.pack(pdu[0], _READY, self._events & 0xFFFF)

    def event_log(self, pdu: bytes) -> bytes:
        """Function 12: the same, the message count, and the last events, the latest first."""
        size = _LOG.size - 2 + len(self._log)
        return _LOG.pack(pdu[0], size, _READY, self._events & 0xFFFF, self.counter(BUS_MESSAGES)) + bytes(self._log)
