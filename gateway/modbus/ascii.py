"""ASCII framing (S 2.5.2): a colon, unit identifier, PDU and LRC as pairs of hexadecimal digits, CR LF.

A frame shows its own ends, so requests and responses are found in the same way. A colon always starts anew, digits may
be lower case, and a frame with a hole of more than one second is dropped.
"""

from binascii import Error as NotHexadecimal
from binascii import unhexlify
from typing import Final

from gateway.modbus.checks import lrc
from gateway.modbus.codes import MAX_ASCII_ADU
from gateway.modbus.frame import Frame

#: Longest time between two characters of a frame, in seconds (S 2.5.2.1).
CHARACTER_GAP: Final = 1.0
#: Unit identifier, one byte of PDU, LRC: the least that stands between colon and CR LF, in bytes.
SHORTEST: Final = 3

START: Final = b":"
END: Final = b"\r\n"
#: A device with seven data bits and parity, heard through a port with eight data bits, leaves its parity in bit 7.
_SEVEN_BITS: Final = bytes(range(128)) * 2


def encode(unit: int, pdu: bytes) -> bytes:
    """The ASCII ADU of `pdu`, with upper-case digits."""
    body = bytes((unit,)) + pdu
    return START + (body + bytes((lrc(body),))).hex().upper().encode() + END


def characters(size: int) -> int:
    """Of the frame with so many bytes between colon and CR LF."""
    return len(START) + 2 * size + len(END)


def plain(text: bytes) -> bytes:
    """The text with seven bits a character."""
    return text.translate(_SEVEN_BITS)


class AsciiCutter:
    """Cuts what a line delivers at the ends of frames. `begun` is what stands behind the last one from its colon on."""

    def __init__(self) -> None:
        self.begun = b""
        self._last = 0.0

    def cut(self, data: bytes, now: float) -> list[tuple[int, bytes]]:
        """Take bytes that became readable at `now`. The parts that end with CR LF, in order; none behind the last one.

        Of each: how many characters were passed over before it, and its text.
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
        """Forget what has begun; how much that was."""
        count, self.begun = len(self.begun), b""
        return count


class AsciiFramer:
    """Finds the frames on a line on which somebody else asks: see `RequestFramer`."""

    encode = staticmethod(encode)

    def __init__(self) -> None:
        self._cutter = AsciiCutter()
        self._passed_over = 0
        self.heard_noise = False

    @property
    def unfinished(self) -> int:
        """Characters of a frame that is not complete yet."""
        return len(self._cutter.begun)

    @property
    def behind(self) -> int:
        """Characters since the last frame."""
        return self._passed_over + self.unfinished

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; frames that are complete with them, in order.

        No frame has all of `damaged` ones in it.
        """
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        frames = []
        for before, text in self._cutter.cut(data, now):
            frame = decode(text)
            self._pass_over(before if frame else before + len(text))
            if frame is not None:
                frames.append(frame)
                self._passed_over = 0
        return frames

    def deadline(self) -> float | None:
        """None: a hole in a frame is noticed when its next character comes."""
        return None

    def tick(self, now: float) -> list[Frame]:  # noqa: ARG002 - see deadline
        """Silence never ends an ASCII frame."""
        return []

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """A frame may end before the last of them, or begin behind the first."""
        frames = self.received(data, now) if data else []
        if self.unfinished >= len(data):
            self._pass_over(self._cutter.drop())
        return frames + self.received(last if data else b"\0", now)

    def _pass_over(self, count: int) -> None:
        self._passed_over += count
        self.heard_noise = self.heard_noise or count > 0


def decode(text: bytes) -> Frame | None:
    """The frame whose text this is, from its colon to CR LF; None if it is none."""
    if not text.startswith(START) or len(text) > MAX_ASCII_ADU:
        return None
    try:
        body = unhexlify(text[len(START) : -len(END)])
    except NotHexadecimal:
        return None
    if len(body) < SHORTEST or lrc(body[:-1]) != body[-1]:
        return None
    return Frame(body[0], body[1:-1])
