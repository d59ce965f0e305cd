"""ASCII framing (S 2.5.2): a colon, unit identifier, PDU and LRC as pairs of hexadecimal digits, CR LF.

Requests and responses are found in the same way. A colon always begins a frame, digits may be lower case, and a frame
with a gap of more than one second is dropped.
"""

from binascii import Error as NotHexadecimal
from binascii import unhexlify
from typing import Final

from gateway.modbus.codes import MAX_ASCII_ADU
from gateway.modbus.frame import Frame, RequestFramer

#: Longest time between two characters of a frame, in seconds (S 2.5.2.1).
CHARACTER_GAP: Final = 1.0
#: Bytes between colon and CR LF of the shortest frame: unit identifier, function code, LRC.
SHORTEST: Final = 3

START: Final = b":"
END: Final = b"\r\n"
#: A port with eight data bits receives the parity of a device with seven in bit 7.
_SEVEN_BITS: Final = bytes(range(128)) * 2


def lrc(data: bytes) -> int:
    """Compute the LRC of `data` (S 2.5.2.2): the two's complement of the sum of its bytes, one byte."""
    return -sum(data) & 0xFF


def encode(unit: int, pdu: bytes) -> bytes:
    """Encode the ASCII ADU of `pdu`, with upper-case digits."""
    body = bytes((unit,)) + pdu
    return START + (body + bytes((lrc(body),))).hex().upper().encode() + END


def characters(size: int) -> int:
    """Count the characters of a frame with this many bytes between colon and CR LF."""
    return len(START) + 2 * size + len(END)


def plain(text: bytes) -> bytes:
    """Clear the eighth bit of each character."""
    return text.translate(_SEVEN_BITS)


class AsciiCutter:
    """Cuts received characters at the ends of frames. `begun` is the incomplete frame, from its colon on."""

    def __init__(self) -> None:
        self.begun = b""
        self._last = 0.0

    def cut(self, data: bytes, now: float) -> list[tuple[int, bytes]]:
        """Take bytes. Return the texts that end with CR LF, each with the number of characters skipped before it.

        Characters skipped after the last one form a part with an empty text.
        """
        before = 0
        if now - self._last > CHARACTER_GAP:
            before = self.drop()
        self._last = now
        text = self.begun + plain(data)
        parts: list[tuple[int, bytes]] = []
        at = 0
        while (end := text.find(END, at) + len(END)) >= len(END):
            start = max(text.rfind(START, at, end), at)
            parts.append((before + start - at, text[start:end]))
            before, at = 0, end
        start = text.rfind(START, at)
        if start < 0 or len(text) - start > MAX_ASCII_ADU:
            start = len(text)
        if before + start - at:
            parts.append((before + start - at, b""))
        self.begun = text[start:]
        return parts

    def drop(self) -> int:
        """Drop the incomplete frame. Return its size in characters."""
        count, self.begun = len(self.begun), b""
        return count


class AsciiFramer(RequestFramer):
    """Finds requests on an ASCII line (see RequestFramer)."""

    def __init__(self) -> None:
        super().__init__()
        self._cutter = AsciiCutter()

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the ASCII ADU of `pdu`."""
        return encode(unit, pdu)

    @property
    def unfinished(self) -> int:
        """Characters of the incomplete frame."""
        return len(self._cutter.begun)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes, and return the completed frames; see RequestFramer."""
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        frames = []
        for before, text in self._cutter.cut(data, now):
            frame = decode(text)
            self._skip(before if frame else before + len(text))
            if frame is not None:
                frames.append(frame)
                self._skipped = 0
        return frames

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """Take damaged bytes: a frame may end before the last of them, or begin after the first."""
        frames = self.received(data, now) if data else []
        if self.unfinished >= len(data):
            self._skip(self._cutter.drop())
        return frames + self.received(last if data else b"\0", now)


def decode(text: bytes) -> Frame | None:
    """Decode the frame that `text` is, from its colon to CR LF; None if it is not one."""
    if not text.startswith(START) or not len(START) + len(END) <= len(text) <= MAX_ASCII_ADU:
        return None
    try:
        body = unhexlify(text[len(START) : -len(END)])
    except NotHexadecimal:
        return None
    if len(body) < SHORTEST or lrc(body[:-1]) != body[-1]:
        return None
    return Frame(body[0], body[1:-1])
