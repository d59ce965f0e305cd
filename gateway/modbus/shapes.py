"""Sizes of PDUs: told by the function, by the first bytes, or only by the silence after the PDU.

Also the sizes of file records, functions 20 and 21: a request may name several, each in its own file (A 6.14, 6.15).
"""

from typing import Final

from gateway.errors import IllegalAddress, IllegalValue, RequestError
from gateway.modbus.codes import MAX_PDU, FunctionCode

#: Bytes before a record's registers: reference type (only 6 is defined), file, record, number of registers.
_RECORD_HEAD: Final = 7
_REFERENCE_TYPE: Final = 6


class Shape:
    """A PDU of one of `sizes`, in bytes. Its first `told_by` bytes tell its size, or that only silence ends it.

    With `count_at` they end with a byte count that begins at that byte. `longest` is the largest size; 0 if only
    silence ends the PDU. `rule` is the error for a PDU that does not fit.
    """

    def __init__(self, told_by: int, sizes: range, rule: str, *, longest: int, count_at: int = 0) -> None:
        self.told_by = told_by
        self.sizes = sizes
        self.rule = rule
        self.longest = longest
        self._count_at = count_at

    def size(self, head: bytes) -> int:
        """Return the size, or the number of bytes needed to know more of it; 0 if only silence ends the PDU."""
        at, told_by = self._count_at, self.told_by
        if len(head) < told_by:
            return told_by
        if not at:
            return self.longest
        return told_by + (head[at] if at + 1 == told_by else head[at] << 8 | head[at + 1])

    def fits(self, pdu: bytes) -> bool:
        """Tell whether a whole PDU has this shape."""
        return len(pdu) in self.sizes and self.size(pdu) in (0, len(pdu))


class Identification(Shape):
    """Objects of a device identification: their number in byte 6; identifier, length, value of each (A 6.21)."""

    def size(self, head: bytes) -> int:
        """Return the size, or the number of bytes needed to know more of it."""
        size = 7
        for _ in range(head[6] if len(head) > 6 else 0):
            size += 2
            if len(head) < size:
                break
            size += head[size - 1]
        return size


def fixed(size: int) -> Shape:
    """Make the shape of a PDU of always the same size."""
    return Shape(1, range(size, size + 1), f"the length must be {size} bytes", longest=size)


def counted(at: int, counts: range = range(MAX_PDU), *, width: int = 1) -> Shape:
    """Make the shape of a PDU with a byte count at byte `at`, of `width` bytes, whose value is one of `counts`."""
    head = at + width
    sizes = range(head + counts.start, min(head + counts.stop, MAX_PDU + 1), counts.step)
    rule = f"the byte count must be {counts.start} to {sizes[-1] - head}, and that of the bytes after it"
    return Shape(head, sizes, rule, longest=sizes[-1], count_at=at)


def any_size(least: int) -> Shape:
    """Make the shape of a PDU of at least `least` bytes that only silence ends."""
    return Shape(least, range(least, MAX_PDU + 1), f"the length must be {least} to {MAX_PDU} bytes", longest=0)


def need(fits: bool, pdu: bytes, rule: str, error: type[RequestError] = IllegalValue) -> None:  # noqa: FBT001
    """Raise `error` with the rule and the bytes of `pdu`, unless `fits`."""
    if not fits:
        raise error(f"function {pdu[0]:02d}: {rule}: {pdu.hex(' ').upper()}")


def record_registers(pdu: bytes) -> list[int]:
    """Count the registers of each record in a request.

    Raises:
        IllegalValue: the byte count does not match the records.
        IllegalAddress: a record has another reference type than 6.
    """
    counts, types, at = [], set(), 2
    while at < len(pdu):
        types.add(pdu[at])
        counts.append(int.from_bytes(pdu[at + 5 : at + _RECORD_HEAD], "big"))
        at += _RECORD_HEAD + (2 * counts[-1] if pdu[0] == FunctionCode.WRITE_FILE_RECORD else 0)
    need(at == len(pdu), pdu, "the byte count must be that of the records")
    need(types == {_REFERENCE_TYPE}, pdu, f"the reference type must be {_REFERENCE_TYPE}", IllegalAddress)
    return counts


def record_bytes(request: bytes) -> int:
    """Compute the byte count of the response with the records that a request reads."""
    return sum(2 + 2 * count for count in record_registers(request))


def are_records(request: bytes, response: bytes) -> bool:
    """Tell whether the records in a response of the right size have the requested sizes and the reference type."""
    at = 2
    for count in record_registers(request):
        if response[at : at + 2] != bytes((1 + 2 * count, _REFERENCE_TYPE)):
            return False
        at += 2 + 2 * count
    return True
