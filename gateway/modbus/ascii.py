"""ASCII framing (S 2.5.2): a colon, unit identifier, PDU and LRC as pairs of hexadecimal digits, CR LF."""

from binascii import Error as NotHexadecimal
from binascii import unhexlify
from typing import Final

from gateway.modbus.checks import lrc
from gateway.modbus.codes import MAX_ASCII_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu

#: Longest time between two characters of a frame, in seconds (S 2.5.2.1).
CHARACTER_GAP: Final = 1.0

_START = b":"
_END = b"\r\n"
#: A device with seven data bits and parity, heard through a port with eight data bits, leaves its parity in bit 7.
_SEVEN_BITS = bytes(range(128)) * 2
#: Unit identifier, one byte of PDU, LRC.
_SHORTEST = 3
#: The same of an exception, whose PDU has two bytes.
_EXCEPTION = 4


def encode(unit: int, pdu: bytes) -> bytes:
    """The ASCII ADU of `pdu`, with upper-case digits."""
    body = bytes((unit,)) + pdu
    return _START + (body + bytes((lrc(body),))).hex().upper().encode() + _END


class AsciiFramer:
    """Cuts frames out of what a line delivers; the same for requests and responses, since a frame shows its own ends.

    A colon always starts anew, digits may be lower case, and a frame with a hole of more than one second is dropped.
    """

    def __init__(self) -> None:
        self._buffer = b""
        self._passed_over = 0
        self._last = 0.0
        self._head = b""
        self._size = 0
        self.heard_noise = False

    encode = staticmethod(encode)

    @property
    def is_clean(self) -> bool:
        """Whether nothing but frames that were handed over has been received since `expect`."""
        return not (self.heard_noise or self._buffer)

    @property
    def unfinished(self) -> int:
        """Characters of a frame that is not complete yet."""
        return len(self._buffer)

    @property
    def behind(self) -> int:
        """Characters since the last frame."""
        return self._passed_over + len(self._buffer)

    def expect(self, unit: int | None, asked: RequestPdu) -> None:
        """A request goes on the line: forget what was received."""
        self._buffer = b""
        self.heard_noise = False
        is_foretold = unit is not None and asked.response_size is not None
        self._head = _START + (bytes((unit or 0,)) + asked.response_head).hex().upper().encode()
        self._size = _characters((asked.response_size or 0) + 2) if is_foretold else 0

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; frames that are complete with them, in order.

        No frame has all of `damaged` ones in it.
        """
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        if now - self._last > CHARACTER_GAP:
            self._drop(len(self._buffer))
        self._last = now
        *texts, self._buffer = (self._buffer + data.translate(_SEVEN_BITS)).split(_END)
        frames = [frame for text in texts if (frame := self._decode(text)) is not None]
        self._drop_all_but_the_last_start()
        return frames

    @property
    def missing(self) -> int:
        """So many characters must come before there can be a response; 0 when nothing has begun, or that is not known.

        A colon may start anew at any time, and what it starts may be an exception.
        """
        here = len(self._buffer)
        if not here:
            return 0
        if self._size and self._buffer.upper().startswith(self._head):
            return max(0, min(self._size - here, _characters(_EXCEPTION)))
        return max(0, _characters(_SHORTEST) - here)

    def deadline(self) -> float | None:
        """None: a hole in a frame is noticed when its next character comes."""
        return None

    def tick(self, now: float) -> list[Frame]:  # noqa: ARG002 - see deadline
        """Silence never ends an ASCII frame."""
        return []

    def conclude(self) -> list[Frame]:
        """No more is awaited: an unfinished frame is noise so far, and no frame was held back. Changes nothing."""
        self.heard_noise = self.heard_noise or bool(self._buffer)
        return []

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """A frame may end before the last of them, or begin behind the first."""
        frames = self.received(data, now) if data else []
        if len(self._buffer) >= len(data):
            self._drop(len(self._buffer))
        return frames + self.received(last if data else b"\0", now)

    def _decode(self, text: bytes) -> Frame | None:
        before, start, digits = text.rpartition(_START)
        try:
            body = unhexlify(digits)
        except NotHexadecimal:
            body = b""
        too_long = len(start + digits + _END) > MAX_ASCII_ADU
        if not start or too_long or len(body) < _SHORTEST or lrc(body[:-1]) != body[-1]:
            self.heard_noise = True
            self._passed_over += len(text + _END)
            return None
        self._passed_over = 0
        self.heard_noise = self.heard_noise or bool(before)
        return Frame(body[0], body[1:-1])

    def _drop_all_but_the_last_start(self) -> None:
        start = self._buffer.rfind(_START)
        if start < 0 or len(self._buffer) - start > MAX_ASCII_ADU:
            start = len(self._buffer)
        self._drop(start)

    def _drop(self, count: int) -> None:
        if count:
            self._buffer = self._buffer[count:]
            self._passed_over += count
            self.heard_noise = True


def _characters(size: int) -> int:
    """Of the frame with so many bytes between colon and CR LF."""
    return len(_START) + 2 * size + len(_END)
