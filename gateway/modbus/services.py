"""The functions that read and write none of the four tables: diagnostics, files, queues, identification.

`expected` checks a request and foretells its response; `fits` is what a response must keep to beyond that.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from gateway.errors import IllegalDataAddress
from gateway.modbus.codes import DEVICE_IDENTIFICATION, MAX_PDU, FunctionCode
from gateway.modbus.foretell import ONE_WORD_DIAGNOSTICS, response_size
from gateway.modbus.structure import need

#: Sub-functions of 08 (A 6.8.1). The counters are all that are known of 0B-12.
RETURN_QUERY_DATA: Final = 0x00
RETURN_DIAGNOSTIC_REGISTER: Final = 0x02
FORCE_LISTEN_ONLY: Final = 0x04
CLEAR_COUNTERS: Final = 0x0A
COUNTERS: Final = range(0x0B, 0x13)
CLEAR_OVERRUN_COUNTER: Final = 0x14

#: Codes of 43/14: a stream of basic, regular or extended objects, or one object (A 6.21).
STREAM_CODES: Final = range(1, 4)
ONE_OBJECT: Final = 4

#: What a file record is called by; no other reference type is defined (A 6.14).
_REFERENCE_TYPE: Final = 6
#: Reference type, file, record and length.
_RECORD_HEAD: Final = 7
#: Byte counts of 20 and 21: from one record on, with a register if it is written (A 6.14, 6.15).
_FILE_READ: Final = range(0x07, 0xF6)
_FILE_WRITTEN: Final = range(0x09, 0xFC)
#: Bytes of the event log's response before the first event, and the most events (A 6.10).
_LOG_HEAD, MOST_EVENTS = 8, 64
#: Bytes of a queue's response before its first register, and the most registers (A 6.18).
_QUEUE_HEAD, _MOST_QUEUED = 5, 31


class Expected(NamedTuple):
    """The response to a request: see `RequestPdu`, whose last fields these are."""

    head: bytes
    size: int | None
    limit: int = 0
    records: int = 0


def expected(pdu: bytes) -> Expected:
    """The response that a request of one of `FUNCTIONS` may expect.

    Raises:
        IllegalDataValue: a length or byte count is against the specification, or the code of 43/14.
        IllegalDataAddress: a file record has another reference type than 6.
    """
    return _REQUESTS[pdu[0]](pdu)


def fits(request: bytes, response: bytes) -> bool:
    """Whether a response with the right beginning, and the size if that was foretold, is well formed."""
    rule = _RESPONSES.get(request[0])
    return rule is None or rule(request, response)


def sub_function(pdu: bytes) -> int:
    """The sub-function of a request with function 08."""
    return int.from_bytes(pdu[1:3], "big")


def is_answered(pdu: bytes) -> bool:
    """Whether there is a response to a request: to all but the one that makes its unit listen only (A 6.8.1)."""
    return pdu[0] != FunctionCode.DIAGNOSTICS or sub_function(pdu) != FORCE_LISTEN_ONLY


def _bare(size: int | None, limit: int = 0) -> Callable[[bytes], Expected]:
    """A request that is nothing but its function code."""

    def expect(pdu: bytes) -> Expected:
        need(len(pdu) == 1, pdu, "the length must be 1 byte")
        return Expected(pdu, size, limit)

    return expect


def _diagnostics(pdu: bytes) -> Expected:
    """Sub-functions that are not known here pass: devices have their own (A 6.8)."""
    need(3 <= len(pdu) <= MAX_PDU, pdu, f"the length must be 3 to {MAX_PDU} bytes")
    asked = sub_function(pdu)
    if asked == RETURN_QUERY_DATA:
        need(len(pdu) > 3 and len(pdu) % 2 == 1, pdu, "the data must be words")
        return Expected(pdu, len(pdu))
    if asked not in ONE_WORD_DIAGNOSTICS:
        return Expected(pdu[:3], None)
    need(len(pdu) == 5, pdu, "the length must be 5 bytes")
    return Expected(pdu[:3] if asked == RETURN_DIAGNOSTIC_REGISTER or asked in COUNTERS else pdu, 5)


def _read_files(pdu: bytes) -> Expected:
    _need_byte_count(pdu, _FILE_READ)
    need(pdu[1] % _RECORD_HEAD == 0, pdu, f"the byte count must be {_RECORD_HEAD} for each record")
    counts = _counts_read(pdu)
    size = 2 + sum(2 + 2 * count for count in counts)
    need(size <= MAX_PDU, pdu, f"the response would have more than {MAX_PDU} bytes")
    _need_reference_type(pdu, pdu[2::_RECORD_HEAD])
    head = bytes((pdu[0], size - 2, 1 + 2 * counts[0], _REFERENCE_TYPE))
    return Expected(head, size, records=sum(counts))


def _write_files(pdu: bytes) -> Expected:
    """The response is an echo (A 6.15)."""
    _need_byte_count(pdu, _FILE_WRITTEN)
    at, types, records = 2, b"", 0
    while at < len(pdu):
        count = int.from_bytes(pdu[at + 5 : at + _RECORD_HEAD], "big")
        types += pdu[at : at + 1]
        records += count
        at += _RECORD_HEAD + 2 * count
        need(at <= len(pdu), pdu, "the byte count must be that of the records")
    _need_reference_type(pdu, types)
    return Expected(pdu, len(pdu), records=records)


def _read_queue(pdu: bytes) -> Expected:
    need(len(pdu) == 3, pdu, "the length must be 3 bytes")
    return Expected(pdu[:1], None, _QUEUE_HEAD + 2 * _MOST_QUEUED, records=_MOST_QUEUED)


def _encapsulated(pdu: bytes) -> Expected:
    """Types other than the identification pass: they belong to whoever defined them (A 6.19)."""
    need(2 <= len(pdu) <= MAX_PDU, pdu, f"the length must be 2 to {MAX_PDU} bytes")
    if pdu[1] != DEVICE_IDENTIFICATION:
        return Expected(pdu[:2], None)
    need(len(pdu) == 4, pdu, "the length must be 4 bytes")
    need(pdu[2] == ONE_OBJECT or pdu[2] in STREAM_CODES, pdu, f"the code must be 1 to {ONE_OBJECT}")
    return Expected(pdu[:3], None, MAX_PDU)


def _need_byte_count(pdu: bytes, counts: range) -> None:
    need(len(pdu) >= 2, pdu, "the length must be 2 bytes and the records")
    need(pdu[1] in counts, pdu, f"the byte count must be {counts[0]} to {counts[-1]}")
    need(len(pdu) == 2 + pdu[1], pdu, f"the length must be {2 + pdu[1]} bytes")


def _need_reference_type(pdu: bytes, types: bytes) -> None:
    """A 6.14, 6.15: a wrong one is an address that does not exist."""
    fits = all(each == _REFERENCE_TYPE for each in types)
    need(fits, pdu, f"the reference type must be {_REFERENCE_TYPE}", IllegalDataAddress)


def _counts_read(pdu: bytes) -> list[int]:
    """The registers of each record that is read: the last word of each."""
    return [int.from_bytes(pdu[at - 2 : at], "big") for at in range(2 + _RECORD_HEAD, len(pdu) + 1, _RECORD_HEAD)]


def _is_whole(request: bytes, response: bytes) -> bool:  # noqa: ARG001 - one of the rules
    return response_size(response) == len(response)


def _is_log(request: bytes, response: bytes) -> bool:
    return _is_whole(request, response) and _LOG_HEAD <= len(response) <= _LOG_HEAD + MOST_EVENTS


def _are_records(request: bytes, response: bytes) -> bool:
    """Each record has its own byte count, and the reference type (A 6.14)."""
    at = 2
    for count in _counts_read(request):
        if response[at : at + 2] != bytes((1 + 2 * count, _REFERENCE_TYPE)):
            return False
        at += 2 + 2 * count
    return True


def _is_queue(request: bytes, response: bytes) -> bool:
    """Byte count and queue count say the same (A 6.18)."""
    queued = int.from_bytes(response[3:_QUEUE_HEAD], "big")
    return _is_whole(request, response) and queued <= _MOST_QUEUED and len(response) == _QUEUE_HEAD + 2 * queued


def _is_encapsulated(request: bytes, response: bytes) -> bool:
    """Who asks for one object gets that one (A 6.21)."""
    if request[1] != DEVICE_IDENTIFICATION:
        return True
    one = request[2] != ONE_OBJECT or response[6:8] == bytes((1, request[3]))
    return one and _is_whole(request, response) and len(response) <= MAX_PDU


_REQUESTS: Final[dict[int, Callable[[bytes], Expected]]] = {
    FunctionCode.READ_EXCEPTION_STATUS: _bare(2),
    FunctionCode.DIAGNOSTICS: _diagnostics,
    FunctionCode.GET_COMM_EVENT_COUNTER: _bare(5),
    FunctionCode.GET_COMM_EVENT_LOG: _bare(None, _LOG_HEAD + MOST_EVENTS),
    FunctionCode.REPORT_SERVER_ID: _bare(None, MAX_PDU),
    FunctionCode.READ_FILE_RECORD: _read_files,
    FunctionCode.WRITE_FILE_RECORD: _write_files,
    FunctionCode.READ_FIFO_QUEUE: _read_queue,
    FunctionCode.ENCAPSULATED_INTERFACE: _encapsulated,
}

_RESPONSES: Final[dict[int, Callable[[bytes, bytes], bool]]] = {
    FunctionCode.GET_COMM_EVENT_LOG: _is_log,
    FunctionCode.REPORT_SERVER_ID: _is_whole,
    FunctionCode.READ_FILE_RECORD: _are_records,
    FunctionCode.READ_FIFO_QUEUE: _is_queue,
    FunctionCode.ENCAPSULATED_INTERFACE: _is_encapsulated,
}

#: The functions that this module knows.
FUNCTIONS: Final[frozenset[int]] = frozenset(_REQUESTS)
