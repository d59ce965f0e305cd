"""The four tables of a unit (A 4.3), coils, discrete inputs, input and holding registers, and the functions on them.

Functions read and write a table in the encoding of the protocol, after checking `has`: coils packed eight to a byte,
registers high byte first. For all other users the items of a table are numbers.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from struct import Struct, calcsize, pack, unpack
from typing import ClassVar, Final

from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import RequestPdu, Span
from gateway.profiles.profile import Range, covers
from gateway.registers.items import pack_bits, unpack_bits
from gateway.registers.masks import masked

#: Addresses have 16 bits: the last one of the largest table (A 4.4).
LAST_ADDRESS: Final = 0xFFFF

#: Values of consecutive items: the address of the first one, and the numbers.
Values = tuple[int, Sequence[int]]


class Table(ABC):
    """The items of one area, 0 at first. They exist at the addresses in `ranges` (ascending, adjacent ones joined).

    Raises:
        ValueError: a range is empty or leaves the addresses 0-65535.
    """

    __slots__ = ("_contents", "area", "ranges")

    #: The `struct` format of an item, and its largest value.
    _format: ClassVar[str]
    _largest: ClassVar[int]

    def __init__(self, area: Area, ranges: tuple[Range, ...]) -> None:
        for first, last in ranges:
            if not 0 <= first <= last <= LAST_ADDRESS:
                raise ValueError(f"{area} {first}-{last} is no range of addresses")
        self.area = area
        self.ranges = ranges
        # From address 0 on, gaps included, so that a read is one slice; the largest table takes 128 KiB.
        self._contents = bytearray(calcsize(self._format) * max((last + 1 for _, last in ranges), default=0))

    def has(self, span: Span) -> bool:
        """Tell whether every item of `span` exists."""
        return covers(self.ranges, span)

    @abstractmethod
    def read(self, span: Span) -> bytes:
        """Return the items of `span`, encoded as in a response."""

    @abstractmethod
    def write(self, span: Span, data: bytes) -> None:
        """Set the items of `span` from `data`, encoded as in a request."""

    def values(self, start: int, count: int) -> tuple[int, ...]:
        """Return the numbers of `count` items from `start` on.

        Raises:
            ValueError: an item does not exist.
        """
        return unpack(f">{count}{self._format}", self._contents[self._place(start, count)])

    def assign(self, start: int, values: Sequence[int]) -> None:
        """Set the items from `start` on.

        Raises:
            ValueError: an item does not exist, or a number does not fit; nothing was changed.
        """
        place = self._place(start, len(values))
        if not all(0 <= value <= self._largest for value in values):
            raise ValueError(f"{self.area} from {start} on: values must be 0 to {self._largest}")
        self._contents[place] = pack(f">{len(values)}{self._format}", *values)

    def replace(self, values: Mapping[int, int]) -> None:
        """Set the items in `values` by address; addresses that do not exist are ignored.

        Raises:
            ValueError: a number does not fit.
        """
        for first, last in self.ranges if values else ():
            present = self.values(first, last + 1 - first)
            self.assign(first, [values.get(address, value) for address, value in enumerate(present, first)])

    def _place(self, start: int, count: int) -> slice:
        span = Span(self.area, start, count)
        if not self.has(span):
            raise ValueError(f"{self.area} {start}-{span.end - 1} do not all exist")
        size = calcsize(self._format)
        return slice(size * start, size * span.end)


class BitTable(Table):
    """Coils or discrete inputs: one byte for each, 0 or 1."""

    __slots__ = ()

    _format = "B"
    _largest = 1

    def read(self, span: Span) -> bytes:
        """Return the items packed eight to a byte, the first in the lowest bit, padded with zeros (A 6.1)."""
        return pack_bits(bytes(self._contents[span.start : span.end]))

    def write(self, span: Span, data: bytes) -> None:
        """Set the items from bytes of eight; the padding of the last byte is ignored (A 6.11)."""
        self._contents[span.start : span.end] = unpack_bits(data, span.count)


class RegisterTable(Table):
    """Input or holding registers: two bytes for each, the high one first."""

    __slots__ = ()

    _format = "H"
    _largest = 0xFFFF

    def read(self, span: Span) -> bytes:
        """Return the items in two bytes each, the high one first (A 4.2)."""
        return bytes(self._contents[2 * span.start : 2 * span.end])

    def write(self, span: Span, data: bytes) -> None:
        """Set the items from two bytes each, the high one first (A 4.2)."""
        self._contents[2 * span.start : 2 * span.end] = data


Tables = Mapping[Area, Table]

_KINDS: Final[dict[Area, type[Table]]] = {
    Area.COILS: BitTable,
    Area.DISCRETE: BitTable,
    Area.INPUT: RegisterTable,
    Area.HOLDING: RegisterTable,
}


def make_tables(ranges: Mapping[Area, tuple[Range, ...]], initial: Mapping[Area, Iterable[Values]]) -> Tables:
    """Make the four tables with their initial values; an area missing in `ranges` has no items.

    Raises:
        ValueError: a range is impossible, or an initial value does not fit.
    """
    tables = {area: kind(area, ranges.get(area, ())) for area, kind in _KINDS.items()}
    for area, runs in initial.items():
        for start, values in runs:
            tables[area].assign(start, values)
    return tables


_WORD = Struct(">H")


def perform(tables: Tables, asked: RequestPdu) -> bytes:
    """Execute a checked request. Return the response PDU.

    Items are written if the function writes, **then** read if it reads: function 23 does both, in this order (A 6.17).
    The response is the header that follows from the request, and then the items that were read.
    """
    if asked.write is not None:
        _WRITERS.get(asked.function, _write)(tables[asked.write.area], asked.write, asked)
    if asked.read is None:
        return asked.response_head
    return asked.response_head + tables[asked.read.area].read(asked.read)


def _write(table: Table, span: Span, asked: RequestPdu) -> None:
    """Write the values of the request."""
    table.write(span, asked.values)


def _write_coil(table: Table, span: Span, asked: RequestPdu) -> None:
    """Write a coil: FF00 is on, 0000 off (A 6.5)."""
    table.write(span, b"\1" if asked.data[3] else b"\0")


def _mask_register(table: Table, span: Span, asked: RequestPdu) -> None:
    """Write (current AND and_mask) OR (or_mask AND NOT and_mask) (A 6.16)."""
    (current,) = _WORD.unpack(table.read(span))
    table.write(span, _WORD.pack(masked(asked.data, current)))


_WRITERS: Final[dict[int, Callable[[Table, Span, RequestPdu], None]]] = {
    FunctionCode.WRITE_SINGLE_COIL: _write_coil,
    FunctionCode.MASK_WRITE_REGISTER: _mask_register,
}
