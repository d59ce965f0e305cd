"""Modbus TCP framing (T 3.1.3): transaction, protocol, length and unit identifier before the PDU."""

from collections.abc import Iterator
from struct import Struct
from typing import Final, NamedTuple

from gateway.errors import NotModbus
from gateway.modbus.codes import MAX_TCP_ADU

_HEADER = Struct(">HHHB")
_PREFIX = Struct(">HHH")
#: Transaction, protocol and length, which the length field does not count.
_UNCOUNTED: Final = 6
#: Unit identifier and function code; unit identifier and the longest PDU.
_LENGTHS: Final = range(2, 255)
#: Protocol identifier of Modbus (T 3.1.3).
_MODBUS: Final = 0
#: Receive buffer of one connection: a burst of 64 reads, four of the largest ADUs.
_BUFFER: Final = 4 * MAX_TCP_ADU


class TcpFrame(NamedTuple):
    """One ADU of a TCP connection, without its header's constants."""

    transaction: int
    unit: int
    pdu: bytes

    def __repr__(self) -> str:
        return f"<TcpFrame transaction={self.transaction} unit={self.unit} {self.pdu.hex(' ').upper()}>"


def encode(transaction: int, unit: int, pdu: bytes) -> bytes:
    """The TCP ADU of `pdu`."""
    return _HEADER.pack(transaction, _MODBUS, len(pdu) + 1, unit) + pdu


def decode(datagram: bytes) -> TcpFrame | None:
    """The ADU in `datagram`, or None if that is anything but one ADU."""
    if len(datagram) <= _HEADER.size:
        return None
    transaction, protocol, length, unit = _HEADER.unpack_from(datagram)
    if protocol != _MODBUS or length not in _LENGTHS or length != len(datagram) - _UNCOUNTED:
        return None
    return TcpFrame(transaction, unit, datagram[_HEADER.size :])


class MbapFramer:
    """Finds the ADUs in a TCP stream, which is received into the framer's own buffer of fixed size.

    Receive into `room()`, call `filled`, then `next` until it returns None. `strict`: other protocols are an error.
    """

    __slots__ = ("_buffer", "_end", "_start", "_strict", "_view")

    def __init__(self, *, strict: bool = False) -> None:
        self._strict = strict
        self._buffer = bytearray(_BUFFER)
        self._view = memoryview(self._buffer)
        self._start = 0
        self._end = 0

    def room(self) -> memoryview:
        """Where the next bytes go; empty while complete ADUs fill the buffer."""
        if self._start == self._end:  # as nearly always
            self._start = self._end = 0
            return self._view
        if self._start:
            rest = self._buffer[self._start : self._end]
            self._view[: len(rest)] = rest
            self._start, self._end = 0, len(rest)
        return self._view[self._end :]

    def filled(self, count: int) -> None:
        """`count` bytes have been received into `room()`."""
        self._end += count

    def next(self) -> TcpFrame | None:
        """The next complete ADU, or None. ADUs of other protocols are skipped (T 4.4.2.2).

        Raises:
            NotModbus: the length field is outside 2 to 254, so that no later ADU can be found; or see `strict`.
        """
        while self._end - self._start >= _UNCOUNTED:
            transaction, protocol, length = _PREFIX.unpack_from(self._buffer, self._start)
            if protocol != _MODBUS and self._strict:
                raise NotModbus(f"a protocol identifier of {protocol}; that of Modbus is 0")
            if length not in _LENGTHS:
                raise NotModbus(f"an MBAP length of {length}; 2 to 254 are possible")
            begin, end = self._start + _UNCOUNTED, self._start + _UNCOUNTED + length
            if end > self._end:
                return None
            self._start = end
            if protocol == _MODBUS:
                return TcpFrame(transaction, self._buffer[begin], bytes(self._view[begin + 1 : end]))
        return None

    def cut(self, data: bytes) -> Iterator[TcpFrame]:
        """The complete ADUs up to the end of `data`; take all of them.

        Raises:
            NotModbus: as `next` does.
        """
        rest = memoryview(data)
        while rest:
            room = self.room()
            count = min(len(room), len(rest))
            room[:count] = rest[:count]
            self.filled(count)
            rest = rest[count:]
            while (adu := self.next()) is not None:
                yield adu

    @property
    def unfinished(self) -> int:
        """Bytes of an ADU that is not complete yet."""
        return self._end - self._start
