"""Protocol data units: the meaning of a request and the form of its response, by the table in `functions`."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from gateway.errors import IllegalFunction, IllegalValue, RequestError
from gateway.modbus.codes import EXCEPTION_BIT, Area, FunctionCode
from gateway.modbus.functions import ALL, ANY_COIL, WIDE, Function, Items, request_size, response_size, row_of
from gateway.modbus.shapes import need

#: The addresses of an area. A span may tell more: a device may go on at address 0 after the last one.
ADDRESSES: Final = 0x10000
#: The most parsed requests that are cached.
MOST_PARSED: Final = 2048
#: Functions with frames that can be a request or a response, unless the response repeats its request. Responses of
#: other functions differ from requests: in size, by an even byte count (03, 04), or by an odd length in place of the
#: reference type 6 (20).
_TWO_WAYS: Final = frozenset(
    {
        FunctionCode.READ_COILS,
        FunctionCode.READ_DISCRETE_INPUTS,
        FunctionCode.DIAGNOSTICS,
        FunctionCode.READ_WRITE_MULTIPLE_REGISTERS,
    }
)


@dataclass(frozen=True, slots=True)
class Span:
    """`count` items of one area from the 0-based address `start` on."""

    area: Area
    start: int
    count: int

    @property
    def end(self) -> int:
        """The first address after the span."""
        return self.start + self.count

    def touches(self, other: "Span") -> bool:
        """Tell whether both have an address."""
        return self.area == other.area and self.start < other.end and other.start < self.end

    def has(self, other: "Span") -> bool:
        """Tell whether it has all addresses of the other one."""
        return self.area == other.area and self.start <= other.start and other.end <= self.end

    def up_to(self, address: int) -> "Span":
        """Make the span that reaches to another address too, before or behind it."""
        start = min(self.start, address)
        return Span(self.area, start, max(self.end, address + 1) - start)

    @property
    def addresses(self) -> str:
        """The addresses as in messages: `7`, or `7-9`."""
        return str(self.start) if self.count == 1 else f"{self.start}-{self.end - 1}"


@dataclass(frozen=True, slots=True)
class RequestPdu:
    """A request PDU whose structure has been checked.

    `read` and `write` are the items it reads and changes, if known. `items` is the larger of the two quantities, or the
    number of registers in files or a queue; 0 for other functions. One that `only_reads` changes nothing, whatever
    right it needs. A unit responds if it `is_answered`.

    A normal response begins with `response_head` and has `response_size` bytes. If that is None, its first bytes tell
    its size, at most `longest_response`; if that is 0, only silence ends it.
    """

    data: bytes
    function: int
    row: Function = field(repr=False, compare=False)
    read: Span | None
    write: Span | None
    items: int
    only_reads: bool
    is_answered: bool
    response_head: bytes
    response_size: int | None
    longest_response: int

    @property
    def values(self) -> bytes:
        """The values for the items of `write`; empty if the request has none."""
        items = self.row.writes
        return self.data[items.values_at :] if items is not None and items.values_at else b""

    def accepts(self, response: bytes) -> bool:
        """Tell whether `response` fits: by function, size and echoed fields, or as an exception response."""
        if len(response) == 2 and response[0] == self.function | EXCEPTION_BIT:
            return True
        if not response.startswith(self.response_head):
            return False
        size = self.response_size
        if len(response) != size and (size is not None or not self.row.response.fits(response)):
            return False
        return self.row.accepts is None or self.row.accepts(self.data, response)

    def __repr__(self) -> str:
        return f"<RequestPdu {self.data.hex(' ').upper()}>"


#: Not `lru_cache`: calling that from compiled modules takes four times the instructions.
_parsed: Final[dict[bytes, RequestPdu]] = {}


def parse_request(pdu: bytes) -> RequestPdu:
    """Parse a request PDU of at least one byte. Results are cached, because clients repeat the same PDUs.

    Raises:
        IllegalFunction: the function code is 0 or above 127.
        IllegalValue: length, quantity, byte count or the value of a coil violates the specification (A 6).
        IllegalAddress: a file record has another reference type than 6.
    """
    asked = _parsed.get(pdu)
    if asked is None:
        asked = parse_anew(pdu)
        if len(_parsed) >= MOST_PARSED:
            _parsed.clear()
        _parsed[pdu] = asked
    return asked


def parse_sent(pdu: bytes) -> RequestPdu:
    """Parse a request PDU that some device may accept: 05 may have any value, 16 may write registers of four bytes.

    Raises:
        RequestError: as parse_request.
    """
    if pdu[0] == FunctionCode.WRITE_SINGLE_COIL:
        return _parse(pdu, ANY_COIL)
    try:
        return parse_request(pdu)
    except IllegalValue:
        if pdu[0] != FunctionCode.WRITE_MULTIPLE_REGISTERS:
            raise
        return parse_wide(pdu)


def parse_wide(pdu: bytes) -> RequestPdu:
    """Parse a request PDU of function 03, 04 or 16 for registers of four bytes.

    Raises:
        IllegalValue: length, quantity or byte count are not those of such registers.
    """
    return _parse(pdu, WIDE[pdu[0]])


def spans_of(pdu: bytes) -> Iterator[Span]:
    """Yield the items that a request PDU reads and writes, as far as it tells them; its structure is not checked."""
    row = row_of(pdu)
    for items in (row.reads, row.writes):
        if items is not None and len(pdu) >= items.at + (4 if items.most > 1 else 2):
            at = items.at
            count = pdu[at + 2] << 8 | pdu[at + 3] if items.most > 1 else 1
            yield Span(items.area, pdu[at] << 8 | pdu[at + 1], count)


def parse_anew(pdu: bytes) -> RequestPdu:
    """Parse a request PDU without the cache. See parse_request."""
    code = pdu[0]
    if not 0 < code < EXCEPTION_BIT:
        raise IllegalFunction(f"function {code} is not a request")
    return _parse(pdu, row_of(pdu))


def can_be_read_both_ways(pdu: bytes) -> bool:
    """Tell whether a PDU is a valid request, and may also be a response that does not repeat its request.

    Possible for 17 to 24 coils or discrete inputs (01, 02), a counter that is 0 (08), and five or more registers of
    function 23. `01 03 10 00 18` is a read of 24 coils, and a response with 24 coils.
    """
    if pdu[0] not in _TWO_WAYS or not len(pdu) == request_size(pdu) == response_size(pdu):
        return False
    try:
        asked = parse_request(pdu)
    except RequestError:
        return False
    return asked.data != asked.response_head


def _parse(pdu: bytes, row: Function) -> RequestPdu:
    code = pdu[0]
    need(row.request.fits(pdu), pdu, row.request.rule)
    for rule, keeps_to in row.rules.items():
        need(keeps_to(pdu), pdu, rule)
    read, write = _span(row.reads, pdu), _span(row.writes, pdu)
    registers = 0 if row.registers is None else sum(row.registers(pdu))
    items = max(registers, read.count if read else 0, write.count if write else 0)
    head = pdu[: row.repeats] if row.head is None else row.head(pdu)
    if row.reads is not None and read is not None:
        head = bytes((code, row.reads.byte_count(read.count)))
    known = row.response.size(head) if len(head) >= row.response.told_by else 0
    size = len(pdu) if row.repeats == ALL else known or None
    longest = size or row.response.longest
    only_reads = row.effect in ("read", "inspect")
    return RequestPdu(pdu, code, row, read, write, items, only_reads, row.is_answered, head, size, longest)


def _span(items: Items | None, pdu: bytes) -> Span | None:
    if items is None:
        return None
    at, count = items.at, 1
    if items.most > 1:
        count = pdu[at + 2] << 8 | pdu[at + 3]
        need(1 <= count <= items.most, pdu, f"the quantity must be 1 to {items.most}")
    if items.values_at:
        need(len(pdu) - items.values_at == items.byte_count(count), pdu, "the byte count must be that of the quantity")
    return Span(items.area, pdu[at] << 8 | pdu[at + 1], count)


def exception_response(function: int, code: int) -> bytes:
    """Make the exception response to `function` with `code` (A 7)."""
    return bytes((function | EXCEPTION_BIT, code))
