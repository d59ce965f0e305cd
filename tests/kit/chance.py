"""Frames that nobody has sent: pieces of two messages that together have a check sum that fits.

    chance = Chance("ascii")
    chance.sent(frame)
    line.deliver(chance.spoil(chunk))

Half an answer and what follows it are a frame once in 256 times on ASCII, once in 65536 on RTU. No client of the line
could know, so those who look for lies leave it out: one bit of such a frame is turned. On RTU only where it would be
the answer to what is asked: elsewhere such frames are many, and to turn a bit would damage what others have sent.
"""

from collections import deque
from typing import Final

from gateway.modbus.ascii import lrc
from gateway.modbus.codes import MAX_ASCII_ADU, MAX_RTU_ADU
from gateway.modbus.functions import response_size
from gateway.modbus.rtu import crc_fits
from gateway.timing.characters import Mode
from kit.noise import flipped

_END: Final = b"\r\n"
_SEVEN_BITS: Final = bytes(range(128)) * 2
#: So many messages may be on their way, in pieces.
_SENT: Final = 512


class Chance:
    """What one line delivers, and what was sent on it."""

    def __init__(self, mode: Mode) -> None:
        self._sent: deque[bytes] = deque(maxlen=_SENT)
        self._before = b""
        #: The unit that is asked, and the function.
        self.asked = b""
        self._ends = _ends_in_ascii if mode == "ascii" else self._ends_in_rtu
        self._read = _without_parity if mode == "ascii" else bytes

    def sent(self, message: bytes) -> None:
        """Somebody sends this, at once or in pieces: a frame in it is none by chance."""
        self._sent.append(self._read(message))

    def spoil(self, chunk: bytes) -> bytes:
        """The chunk, with no frame in it, or in what came before and it, that is no part of one message."""
        known = len(self._before)
        data = self._before + self._read(chunk)
        for start, end in self._ends(data, known):
            if not any(data[start:end] in message for message in reversed(self._sent)):
                chunk = flipped(chunk, 8 * (end - 1 - known))
        self._before = (self._before + self._read(chunk))[-MAX_ASCII_ADU:]
        return chunk

    def _ends_in_rtu(self, data: bytes, known: int) -> list[tuple[int, int]]:
        """Where answers to what is asked begin and end, those that end in the first `known` bytes left out."""
        found, start = [], data.find(self.asked, max(0, known - MAX_RTU_ADU))
        while self.asked and start >= 0:
            end = start + response_size(data[start + 1 : start + 5]) + 3
            if known < end <= len(data) and end > start + 3 and crc_fits(data[start:end]):
                found.append((start, end))
            start = data.find(self.asked, start + 1)
        return found


def _without_parity(text: bytes) -> bytes:
    return text.translate(_SEVEN_BITS)


def _ends_in_ascii(data: bytes, known: int) -> list[tuple[int, int]]:
    """Where frames begin and end in `data`, those that end in its first `known` bytes left out."""
    found, at = [], max(0, known - 1)
    while (at := data.find(_END, at) + len(_END)) >= len(_END):
        start = data.rfind(b":", 0, at)
        if at > known and start >= 0 and _is_ascii_frame(data[start + 1 : at - len(_END)]):
            found.append((start, at))
    return found


def _is_ascii_frame(digits: bytes) -> bool:
    try:
        body = bytes.fromhex(digits.decode())
    except ValueError:
        return False
    return len(body) > 2 and lrc(body[:-1]) == body[-1]
