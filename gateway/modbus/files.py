"""File records, functions 20 and 21: a request may name several, each in its own file (A 6.14, 6.15)."""

from typing import Final

from gateway.errors import IllegalDataAddress
from gateway.modbus.codes import FunctionCode
from gateway.modbus.shapes import need

#: Bytes before a record's registers: reference type (only 6 is defined), file, record, number of registers.
_RECORD_HEAD: Final = 7
_REFERENCE_TYPE: Final = 6


def registers(pdu: bytes) -> list[int]:
    """The number of registers in each record of a request.

    Raises:
        IllegalDataValue: the byte count is not that of the records.
        IllegalDataAddress: a record has another reference type than 6.
    """
    counts, types, at = [], set(), 2
    while at < len(pdu):
        types.add(pdu[at])
        counts.append(int.from_bytes(pdu[at + 5 : at + _RECORD_HEAD], "big"))
        at += _RECORD_HEAD + (2 * counts[-1] if pdu[0] == FunctionCode.WRITE_FILE_RECORD else 0)
    need(at == len(pdu), pdu, "the byte count must be that of the records")
    need(types == {_REFERENCE_TYPE}, pdu, f"the reference type must be {_REFERENCE_TYPE}", IllegalDataAddress)
    return counts


def byte_count(request: bytes) -> int:
    """The byte count of the response with the records that a request reads."""
    return sum(2 + 2 * count for count in registers(request))


def are_records(request: bytes, response: bytes) -> bool:
    """Whether each record in a response of the right size has the requested size, and the reference type."""
    at = 2
    for count in registers(request):
        if response[at : at + 2] != bytes((1 + 2 * count, _REFERENCE_TYPE)):
            return False
        at += 2 + 2 * count
    return True
