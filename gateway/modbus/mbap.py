"""Modbus TCP framing (T 3.1.3): transaction, protocol, length and unit identifier before the PDU."""

from collections.abc import Iterator
from typing import Any, Final

from gateway.compiler import mypyc_attr
from gateway.errors import NotModbus
from gateway.modbus.codes import BROADCAST_UNIT, MAX_TCP_ADU, SERVER_UNIT
from gateway.modbus.framings import likeness

#: Transaction, protocol and length: the bytes that the length field does not count.
_UNCOUNTED: Final = 6
#: The least length: unit identifier and function code. The largest: unit identifier and the longest PDU.
_SHORTEST: Final = 2
_LONGEST: Final = 254
#: Protocol identifier of Modbus (T 3.1.3).
_MODBUS: Final = 0
_PROTOCOL: Final = bytes((0, _MODBUS))
#: The size of the header.
_HEAD: Final = 7
#: Receive buffer of one connection: a burst of 64 reads, four of the largest ADUs.
_BUFFER: Final = 4 * MAX_TCP_ADU
#: The unit identifiers in responses of servers that have only one unit (T 4.4.1.2).
NO_UNIT: Final = (BROADCAST_UNIT, SERVER_UNIT)
#: The most requests in the buffer.
MOST_AT_ONCE: Final = _BUFFER // (_UNCOUNTED + _SHORTEST)


@mypyc_attr(free_list_len=1, acyclic=True)
class TcpFrame:
    """One ADU of a TCP connection, without the constants of its header; equal to the tuple of its parts. See Frame."""

    __slots__ = ("pdu", "transaction", "unit")

    def __init__(self, transaction: int, unit: int, pdu: bytes) -> None:
        self.transaction = transaction
        self.unit = unit
        self.pdu = pdu

    def __iter__(self) -> Iterator[Any]:
        return iter((self.transaction, self.unit, self.pdu))

    def __eq__(self, other: object) -> bool:
        mine = (self.transaction, self.unit, self.pdu)
        return mine == (tuple(other) if isinstance(other, TcpFrame) else other)

    def __hash__(self) -> int:
        return hash((self.transaction, self.unit, self.pdu))

    def __repr__(self) -> str:
        return f"<TcpFrame transaction={self.transaction} unit={self.unit} {self.pdu.hex(' ').upper()}>"


def encode(transaction: int, unit: int, pdu: bytes) -> bytes:
    """Encode the TCP ADU of `pdu`."""
    return (transaction << 40 | _MODBUS << 24 | (len(pdu) + 1) << 8 | unit).to_bytes(_HEAD, "big") + pdu


def decode(datagram: bytes) -> TcpFrame | None:
    """Decode the ADU in `datagram`; None if it is not exactly one ADU."""
    framer = MbapFramer()
    framer.take(datagram)
    try:
        adu = framer.next()
    except NotModbus:
        return None
    return None if framer.unfinished else adu


class MbapFramer:
    """Finds the ADUs in a TCP stream that is received into the framer's own buffer of fixed size.

    Receive into `room()`, call `filled`, then `next` until it returns None. `strict`: other protocols are an error.
    """

    __slots__ = ("_at", "_buffer", "_data", "_filled", "_strict", "_view")

    def __init__(self, *, strict: bool = False) -> None:
        self._strict = strict
        self._buffer = bytearray(_BUFFER)
        self._view = memoryview(self._buffer)
        #: The part of it that was filled last: usually as much comes again, and making it costs more than its bytes.
        self._filled = self._view[:0]
        #: The received bytes, and the place of the next ADU.
        self._data = b""
        self._at = 0

    def room(self) -> memoryview:
        """Return the space for the next bytes; empty while complete ADUs fill the buffer."""
        unfinished = len(self._data) - self._at
        return self._view[: _BUFFER - unfinished] if unfinished else self._view

    def filled(self, count: int) -> None:
        """Take `count` bytes that were received into `room()`."""
        if len(self._filled) != count:
            self._filled = self._view[:count]
        self.take(self._filled.tobytes())

    def take(self, data: bytes) -> None:
        """Take received bytes."""
        self._data = self._data[self._at :] + data if self._at < len(self._data) else data
        self._at = 0

    def next(self) -> TcpFrame | None:
        """Return the next complete ADU, or None. ADUs of other protocols are skipped (T 4.4.2.2).

        Raises:
            NotModbus: the length field is outside 2 to 254, so that no later ADU can be found; there is an RTU or ASCII
                frame; or see `strict`.
        """
        data = self._data
        while len(data) - self._at >= _UNCOUNTED:
            at = self._at
            protocol = data[at + 2] << 8 | data[at + 3]
            length = data[at + 4] << 8 | data[at + 5]
            if protocol != _MODBUS:
                self._check_protocol(protocol)
            if not _SHORTEST <= length <= _LONGEST:
                raise NotModbus(f"an MBAP length of {length}; 2 to 254 are possible{self.hint}")
            end = at + _UNCOUNTED + length
            if end > len(data):
                return None
            self._at = end
            if protocol == _MODBUS:
                return TcpFrame(data[at] << 8 | data[at + 1], data[at + 6], data[at + 7 : end])
        return None

    def holds(self, transaction: bytes) -> bool:
        """Tell whether an ADU with this transaction identifier (two bytes) waits for `next`, or has begun."""
        data, at = self._data, self._at
        while at < len(data):
            begun = data[at : at + 4]
            if len(begun) > 1 and begun == (transaction + _PROTOCOL)[: len(begun)]:
                return True
            if len(data) - at < _UNCOUNTED:
                return False
            at += _UNCOUNTED + (data[at + 4] << 8 | data[at + 5])
        return False

    def cut(self, data: bytes) -> Iterator[TcpFrame]:
        """Take `data`, and yield all ADUs that are complete.

        Raises:
            NotModbus: as `next` does.
        """
        self.take(data)
        while (adu := self.next()) is not None:
            yield adu

    @property
    def has_whole(self) -> bool:
        """Whether `next` has more to do: there is a complete ADU, or something that is not one."""
        data, at = self._data, self._at
        waiting = len(data) - at
        return waiting >= _UNCOUNTED and waiting >= _UNCOUNTED + (data[at + 4] << 8 | data[at + 5])

    @property
    def unfinished(self) -> int:
        """Bytes of the ADU that is not complete yet."""
        return len(self._data) - self._at

    @property
    def hint(self) -> str:
        """The addition to a message if what comes next looks like another framing; else empty."""
        return likeness(self._data[self._at :], "Modbus TCP")

    def _check_protocol(self, protocol: int) -> None:
        """Raise NotModbus for another protocol if `strict`, or if the data looks like RTU or ASCII."""
        if self._strict or self.hint:
            raise NotModbus(f"a protocol identifier of {protocol}; that of Modbus is 0{self.hint}")
