"""Protocol data units: what a request asks for, and which response belongs to it.

A request is read once into a `RequestPdu`. It says which items are read and written, and foretells the response: its
size and the bytes it must begin with. Those two are nearly all that is needed to find the response on a line and to
refuse any other:

| function               | the response begins with       | its size                        |
|------------------------|--------------------------------|---------------------------------|
| 01, 02                 | function, byte count           | 2 + ceil(n/8)                   |
| 03, 04, 23             | function, byte count           | 2 + 2n                          |
| 05, 06, 21, 22         | the whole request              | as the request                  |
| 15, 16                 | function, address, quantity    | 5                               |
| 07                     | function                       | 2                               |
| 08 (A 6.8.1)           | function, sub-function, echoes | as the request; 08/04 has none  |
| 11                     | function                       | 5                               |
| 12, 17, 24             | function                       | told by its byte count          |
| 20                     | function, its sizes            | 2 + 2 for each record + 2n      |
| 43, MEI type 14        | function, type, code           | told by its number of objects   |
| 08 and 43, others      | function, sub-function or type | not foretold                    |
| others                 | function                       | not foretold                    |
| any, exception         | function OR 80h                | 2                               |

What else the response of a function without items must keep to is in `services`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from struct import Struct

from gateway.errors import IllegalFunction
from gateway.modbus import services
from gateway.modbus.codes import EXCEPTION_BIT, MAX_PDU, Area, FunctionCode, only_reads
from gateway.modbus.structure import need

COIL_ON = 0xFF00
COIL_OFF = 0x0000

_TWO_WORDS = Struct(">xHH")
_THREE_WORDS = Struct(">xHHH")
_FOUR_WORDS = Struct(">xHHHH")


@dataclass(frozen=True, slots=True)
class Span:
    """`count` items of one area from `start` on (0-based protocol addresses)."""

    area: Area
    start: int
    count: int

    @property
    def end(self) -> int:
        """The first address behind the span."""
        return self.start + self.count


@dataclass(frozen=True, slots=True)
class RequestPdu:
    """A request PDU whose structure has been checked.

    `read` and `write` are the items it reads and changes; both are None for a function that has none or is not known
    here. `records` is the number of registers that it reads or writes in files or reads from a queue. `items` is the
    larger of the two quantities, or the records; 0 for a function that counts nothing. `only_reads` says that it is
    known to change nothing, `is_answered` that a unit answers it.
    A normal response begins with `response_head` and has `response_size` bytes. Where that is None, the response's own
    first bytes tell its size, at most `response_limit`; if that is 0 too, only silence ends it. `longest_response` is
    the most bytes that a normal response can have; 0 when that is not known.
    """

    data: bytes
    function: int
    read: Span | None
    write: Span | None
    response_head: bytes
    response_size: int | None
    response_limit: int = 0
    records: int = 0
    items: int = field(init=False)
    only_reads: bool = field(init=False)
    is_answered: bool = field(init=False)
    longest_response: int = field(init=False)

    def __post_init__(self) -> None:
        items = max(self.records, *(span.count if span else 0 for span in (self.read, self.write)))
        object.__setattr__(self, "items", items)
        object.__setattr__(self, "only_reads", only_reads(self.data))
        object.__setattr__(self, "is_answered", services.is_answered(self.data))
        longest = self.response_limit if self.response_size is None else self.response_size
        object.__setattr__(self, "longest_response", longest)

    def accepts(self, response: bytes) -> bool:
        """Whether `response` can be the answer: function, size and echoed fields fit, or it is an exception."""
        if len(response) == 2 and response[0] == self.function | EXCEPTION_BIT:
            return True
        if not response.startswith(self.response_head) or self.response_size not in (None, len(response)):
            return False
        return services.fits(self.data, response)

    def __repr__(self) -> str:
        return f"<RequestPdu {self.data.hex(' ').upper()}>"


@lru_cache(maxsize=2048)
def parse_request(pdu: bytes) -> RequestPdu:
    """What the request PDU asks for. Clients poll, so the same few PDUs come again and again: results are kept.

    It has at least its function code, as all that framers deliver. A function that is not known here passes unchecked;
    its response is not foretold.

    Raises:
        IllegalFunction: the function code is 0 or above 127.
        IllegalDataValue: length, quantity, byte count or the value of a coil is against the specification (A 6).
        IllegalDataAddress: a file record has another reference type than 6.
    """
    function = pdu[0]
    if not 0 < function < EXCEPTION_BIT:
        raise IllegalFunction(f"function {function} cannot be asked for")
    return _PARSERS.get(function, _unknown)(pdu)


def exception_response(function: int, code: int) -> bytes:
    """The exception response to `function` (A 7)."""
    return bytes((function | EXCEPTION_BIT, code))


def pack_bits(bits: bytes) -> bytes:
    """Coils or inputs, one 0 or 1 each, as a response carries them: eight a byte, the first one lowest (A 6.1)."""
    size = (len(bits) + 7) // 8
    return int(bits[::-1].translate(_AS_DIGIT) or b"0", 2).to_bytes(size, "little")


def unpack_bits(data: bytes, count: int) -> bytes:
    """The first `count` bits of `data`, one 0 or 1 each: the opposite of `pack_bits`."""
    digits = format(int.from_bytes(data, "little"), f"0{len(data) * 8}b").encode()
    return digits[::-1][:count].translate(_AS_BIT)


_AS_DIGIT = bytes([ord("0"), ord("1")]) + bytes(254)
_AS_BIT = bytes.maketrans(b"01", b"\0\1")


def _reader(area: Area, most: int, bits_per_item: int) -> Callable[[bytes], RequestPdu]:
    def parse(pdu: bytes) -> RequestPdu:
        need(len(pdu) == 5, pdu, "the length must be 5 bytes")
        start, count = _TWO_WORDS.unpack(pdu)
        need(1 <= count <= most, pdu, f"the quantity must be 1 to {most}")
        byte_count = (count * bits_per_item + 7) // 8
        head = bytes((pdu[0], byte_count))
        return RequestPdu(pdu, pdu[0], Span(area, start, count), None, head, 2 + byte_count)

    return parse


def _single_writer(area: Area) -> Callable[[bytes], RequestPdu]:
    def parse(pdu: bytes) -> RequestPdu:
        need(len(pdu) == 5, pdu, "the length must be 5 bytes")
        start, value = _TWO_WORDS.unpack(pdu)
        need(area is not Area.COILS or value in (COIL_ON, COIL_OFF), pdu, "a coil is FF00 or 0000")
        return RequestPdu(pdu, pdu[0], None, Span(area, start, 1), pdu, len(pdu))

    return parse


def _multiple_writer(area: Area, most: int, bits_per_item: int) -> Callable[[bytes], RequestPdu]:
    def parse(pdu: bytes) -> RequestPdu:
        need(len(pdu) >= 6, pdu, "the length must be 6 bytes and the values")
        start, count = _TWO_WORDS.unpack_from(pdu)
        byte_count = (count * bits_per_item + 7) // 8
        need(1 <= count <= most, pdu, f"the quantity must be 1 to {most}")
        need(pdu[5] == byte_count, pdu, f"the byte count must be {byte_count}")
        need(len(pdu) == 6 + byte_count, pdu, f"the length must be {6 + byte_count} bytes")
        return RequestPdu(pdu, pdu[0], None, Span(area, start, count), pdu[:5], 5)

    return parse


def _mask_write(pdu: bytes) -> RequestPdu:
    need(len(pdu) == 7, pdu, "the length must be 7 bytes")
    start, _and_mask, _or_mask = _THREE_WORDS.unpack(pdu)
    return RequestPdu(pdu, pdu[0], None, Span(Area.HOLDING, start, 1), pdu, len(pdu))


def _read_write(pdu: bytes) -> RequestPdu:
    need(len(pdu) >= 10, pdu, "the length must be 10 bytes and the values")
    read_start, read_count, write_start, write_count = _FOUR_WORDS.unpack_from(pdu)
    need(1 <= read_count <= 125, pdu, "the quantity to read must be 1 to 125")
    need(1 <= write_count <= 121, pdu, "the quantity to write must be 1 to 121")
    need(pdu[9] == 2 * write_count, pdu, f"the byte count must be {2 * write_count}")
    need(len(pdu) == 10 + pdu[9], pdu, f"the length must be {10 + pdu[9]} bytes")
    read = Span(Area.HOLDING, read_start, read_count)
    write = Span(Area.HOLDING, write_start, write_count)
    head = bytes((pdu[0], 2 * read_count))
    return RequestPdu(pdu, pdu[0], read, write, head, 2 + 2 * read_count)


def _unknown(pdu: bytes) -> RequestPdu:
    need(len(pdu) <= MAX_PDU, pdu, f"a PDU has at most {MAX_PDU} bytes")
    return RequestPdu(pdu, pdu[0], None, None, pdu[:1], None)


def _service(pdu: bytes) -> RequestPdu:
    return RequestPdu(pdu, pdu[0], None, None, *services.expected(pdu))


#: Limits of each function: A 6.1-6.6, 6.11, 6.12, 6.16, 6.17.
_PARSERS: dict[int, Callable[[bytes], RequestPdu]] = {
    FunctionCode.READ_COILS: _reader(Area.COILS, 2000, 1),
    FunctionCode.READ_DISCRETE_INPUTS: _reader(Area.DISCRETE, 2000, 1),
    FunctionCode.READ_HOLDING_REGISTERS: _reader(Area.HOLDING, 125, 16),
    FunctionCode.READ_INPUT_REGISTERS: _reader(Area.INPUT, 125, 16),
    FunctionCode.WRITE_SINGLE_COIL: _single_writer(Area.COILS),
    FunctionCode.WRITE_SINGLE_REGISTER: _single_writer(Area.HOLDING),
    FunctionCode.WRITE_MULTIPLE_COILS: _multiple_writer(Area.COILS, 1968, 1),
    FunctionCode.WRITE_MULTIPLE_REGISTERS: _multiple_writer(Area.HOLDING, 123, 16),
    FunctionCode.MASK_WRITE_REGISTER: _mask_write,
    FunctionCode.READ_WRITE_MULTIPLE_REGISTERS: _read_write,
    **dict.fromkeys(services.FUNCTIONS, _service),
}

#: The functions whose structure is checked.
KNOWN_FUNCTIONS = frozenset(_PARSERS)
