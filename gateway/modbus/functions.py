"""The table of functions (Application Protocol V1.1b3, section 6).

All checks of requests and responses, the sizes of frames, and the sets of functions that only read or may be broadcast
follow from it. A function without a row passes unchecked: only its device knows what it means.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from gateway.modbus import codes
from gateway.modbus.codes import DEVICE_IDENTIFICATION, EXCEPTION_BIT, MAX_PDU, ONE_OBJECT, Area
from gateway.modbus.codes import FunctionCode as Code
from gateway.modbus.shapes import (
    Identification,
    Shape,
    any_size,
    are_records,
    counted,
    fixed,
    record_bytes,
    record_registers,
)

#: The effect of a request. A `broadcast` is a write that may be sent to unit 0 (S 2.1). An `inspect` changes nothing,
#: but needs the right to write, like the rest of its function.
Effect = Literal["read", "inspect", "write", "broadcast"]

#: The beginning of a request for device identification: the only use of function 43 that is known to only read.
READING_IDENTIFICATION: Final = bytes((Code.ENCAPSULATED_INTERFACE, DEVICE_IDENTIFICATION))
#: The most events in a log (A 6.10).
MOST_EVENTS: Final = 64
#: The response repeats the whole request.
ALL: Final = MAX_PDU


@dataclass(frozen=True, slots=True)
class Items:
    """Up to `most` items of one area in a request.

    Their address is at byte `at`, followed by their quantity if there can be several. Their values begin at byte
    `values_at`; 0 if the request has none. A register has `width` bytes.
    """

    area: Area
    most: int
    at: int = 1
    values_at: int = 0
    width: int = 2

    def byte_count(self, count: int) -> int:
        """Compute the bytes of `count` items: `width` per register, one per eight coils or inputs."""
        return self.width * count if self.area in (Area.HOLDING, Area.INPUT) else (count + 7) // 8


@dataclass(frozen=True, slots=True)
class Function:
    """One row: a function, with its `section` of the specification.

    A normal response begins with the bytes of the request that it `repeats`; with the function code and a byte count if
    it `reads` items; or with its own `head`. A request must also follow the `rules`, and a response must satisfy
    `accepts(request, response)`. `registers` counts those of files or a queue in a request. Where the function code is
    not enough, `parts` are rows by the first bytes of their requests, and this row is for all others.
    """

    code: int
    section: str
    effect: Effect
    request: Shape
    response: Shape
    repeats: int = 1
    reads: Items | None = None
    writes: Items | None = None
    is_answered: bool = True
    rules: Mapping[str, Callable[[bytes], bool]] = field(default_factory=dict)
    registers: Callable[[bytes], list[int]] | None = None
    head: Callable[[bytes], bytes] | None = None
    accepts: Callable[[bytes, bytes], bool] | None = None
    parts: "Mapping[bytes, Function]" = field(default_factory=dict)


def row_of(head: bytes) -> Function:
    """Return the row of the request or response that begins with `head`."""
    row = _BY_CODE[head[0]]
    return row.parts.get(head[: row.repeats], row) if row.parts else row


def request_size(head: bytes) -> int:
    """Compute the size of the request PDU that begins with `head`; see Shape.size."""
    if not head:
        return 1
    row = _BY_CODE[head[0]]
    return (row_of(head) if row.parts else row).request.size(head)


def response_size(head: bytes) -> int:
    """Compute the size of the response PDU, normal or exception, that begins with `head`; see Shape.size."""
    if not head:
        return 1
    row = _BY_CODE[head[0]]
    return (row_of(head) if row.parts else row).response.size(head)


def only_reads(pdu: bytes) -> bool:
    """Tell whether a request is known to change nothing, and needs no right to write (an `inspect` does)."""
    return row_of(pdu).effect == "read"


def _one_word(*sub_functions: int, asks: bool = False, is_answered: bool = True) -> dict[bytes, Function]:
    """Make rows for sub-functions of 08 with one word of data in request and response.

    With `asks` the data of the request is 0000, and the response repeats only the sub-function.
    """
    effect: Effect = "inspect" if asks else "write"
    repeats = 3 if asks else 5
    rules = {"the data must be 0000": lambda pdu: pdu[3:] == b"\0\0"} if asks else {}
    row = Function(Code.DIAGNOSTICS, "6.8.1", effect, fixed(5), fixed(5), repeats, is_answered=is_answered, rules=rules)
    return {bytes((Code.DIAGNOSTICS, 0, each)): row for each in sub_functions}


# fmt: off
_ROWS: Final = (
    Function(Code.READ_COILS, "6.1", "read", fixed(5), counted(1), reads=Items(Area.COILS, 2000)),
    Function(Code.READ_DISCRETE_INPUTS, "6.2", "read", fixed(5), counted(1), reads=Items(Area.DISCRETE, 2000)),
    Function(Code.READ_HOLDING_REGISTERS, "6.3", "read", fixed(5), counted(1), reads=Items(Area.HOLDING, 125)),
    Function(Code.READ_INPUT_REGISTERS, "6.4", "read", fixed(5), counted(1), reads=Items(Area.INPUT, 125)),
    Function(Code.WRITE_SINGLE_COIL, "6.5", "broadcast", fixed(5), fixed(5), 5, writes=Items(Area.COILS, 1),
             rules={"a coil is FF00 or 0000": lambda pdu: pdu[3:] in (b"\xff\0", b"\0\0")}),
    Function(Code.WRITE_SINGLE_REGISTER, "6.6", "broadcast", fixed(5), fixed(5), 5,
             writes=Items(Area.HOLDING, 1, values_at=3)),
    Function(Code.READ_EXCEPTION_STATUS, "6.7", "read", fixed(1), fixed(2)),
    Function(Code.DIAGNOSTICS, "6.8", "write", any_size(3), any_size(3), 3, parts={
        b"\x08\0\0": Function(Code.DIAGNOSTICS, "6.8.1", "write", any_size(3), any_size(3), ALL,
                              rules={"the data must be words": lambda pdu: len(pdu) > 3 and len(pdu) % 2 == 1}),
        **_one_word(0x01, 0x03, codes.CLEAR_COUNTERS, codes.CLEAR_OVERRUN_COUNTER),  # restart, change the delimiter
        **_one_word(0x02, *codes.COUNTERS, asks=True),  # the diagnostic register, counters
        **_one_word(0x04, is_answered=False),  # only listen from now on
    }),
    Function(Code.GET_COMM_EVENT_COUNTER, "6.9", "read", fixed(1), fixed(5)),
    Function(Code.GET_COMM_EVENT_LOG, "6.10", "read", fixed(1), counted(1, range(6, 6 + MOST_EVENTS + 1))),
    Function(Code.WRITE_MULTIPLE_COILS, "6.11", "broadcast", counted(5), fixed(5), 5,
             writes=Items(Area.COILS, 1968, values_at=6)),
    Function(Code.WRITE_MULTIPLE_REGISTERS, "6.12", "broadcast", counted(5), fixed(5), 5,
             writes=Items(Area.HOLDING, 123, values_at=6)),
    Function(Code.REPORT_SERVER_ID, "6.13", "read", fixed(1), counted(1)),
    Function(Code.READ_FILE_RECORD, "6.14", "read", counted(1, range(7, 246, 7)), counted(1),
             registers=record_registers, head=lambda pdu: bytes((pdu[0], record_bytes(pdu))),
             rules={f"the response must fit {MAX_PDU} bytes": lambda pdu: 2 + record_bytes(pdu) <= MAX_PDU},
             accepts=are_records),
    Function(Code.WRITE_FILE_RECORD, "6.15", "write", counted(1, range(9, 252)), counted(1), ALL,
             registers=record_registers),
    Function(Code.MASK_WRITE_REGISTER, "6.16", "broadcast", fixed(7), fixed(7), 7, writes=Items(Area.HOLDING, 1)),
    Function(Code.READ_WRITE_MULTIPLE_REGISTERS, "6.17", "write", counted(9), counted(1),
             reads=Items(Area.HOLDING, 125), writes=Items(Area.HOLDING, 121, at=5, values_at=10)),
    Function(Code.READ_FIFO_QUEUE, "6.18", "read", fixed(3), counted(1, range(2, 65, 2), width=2),
             registers=lambda _: [31],  # at most; byte count and queue count of the response must agree
             accepts=lambda _, response: 5 + 2 * int.from_bytes(response[3:5], "big") == len(response)),
    Function(Code.ENCAPSULATED_INTERFACE, "6.19", "write", any_size(2), any_size(2), 2, parts={
        READING_IDENTIFICATION: Function(
            Code.ENCAPSULATED_INTERFACE, "6.21", "read", fixed(4),
            Identification(MAX_PDU, range(7, 254), "the objects must tell the length", longest=MAX_PDU), 3,
            rules={f"the code must be 1 to {ONE_OBJECT}": lambda pdu: 1 <= pdu[2] <= ONE_OBJECT},
            accepts=lambda request, response: request[2] != ONE_OBJECT or response[6:8] == bytes((1, request[3]))),
    }),
)
# fmt: on

#: The table by function code.
FUNCTIONS: Final[Mapping[int, Function]] = {row.code: row for row in _ROWS}
KNOWN_FUNCTIONS: Final = frozenset(FUNCTIONS)
#: Functions that only read; that may be sent to unit 0; that read or write the four areas.
READING_FUNCTIONS: Final = frozenset(row.code for row in _ROWS if row.effect == "read")
BROADCAST_FUNCTIONS: Final = frozenset(row.code for row in _ROWS if row.effect == "broadcast")
TABLE_FUNCTIONS: Final = frozenset(row.code for row in _ROWS if row.reads or row.writes)
#: The function that reads each area, and the most items in one request.
READERS: Final = {row.reads.area: (row.code, row.reads.most) for row in _ROWS if row.reads and not row.writes}

#: Function 05 for devices that accept other values too: relay boards that toggle or pulse.
ANY_COIL: Final = replace(FUNCTIONS[Code.WRITE_SINGLE_COIL], rules={})

#: The functions for registers of four bytes, as Enron and others have them; no specification has others for these.
WIDE: Final[Mapping[int, Function]] = {
    Code.READ_HOLDING_REGISTERS: replace(
        FUNCTIONS[Code.READ_HOLDING_REGISTERS], reads=Items(Area.HOLDING, 62, width=4)
    ),
    Code.READ_INPUT_REGISTERS: replace(FUNCTIONS[Code.READ_INPUT_REGISTERS], reads=Items(Area.INPUT, 62, width=4)),
    Code.WRITE_MULTIPLE_REGISTERS: replace(
        FUNCTIONS[Code.WRITE_MULTIPLE_REGISTERS], writes=Items(Area.HOLDING, 61, values_at=6, width=4)
    ),
}

_UNKNOWN: Final = Function(0, "5", "write", any_size(1), any_size(1))
#: An exception response, of two bytes (A 7). No request has such a code.
_EXCEPTION: Final = Function(EXCEPTION_BIT, "7", "write", any_size(1), fixed(2))
_BY_CODE: Final = tuple(_EXCEPTION if code & EXCEPTION_BIT else FUNCTIONS.get(code, _UNKNOWN) for code in range(256))
