"""The scanner of an ASCII line: CR LF ends a frame, never silence (S 2.5.2)."""

from functools import lru_cache
from typing import Final

from gateway.modbus import ascii as ascii_framing
from gateway.modbus.ascii import END, SHORTEST, START, AsciiCutter, characters, decode, plain
from gateway.modbus.scan import EXCEPTION_SIZE, NEVER, Expected, Scanner, Token

#: Unit identifier and LRC around a PDU.
_OVERHEAD: Final = 2

#: Clients repeat the same few requests.
_encoded: Final = lru_cache(maxsize=512)(ascii_framing.encode)


class AsciiScanner(Scanner):
    """Finds the frames on an ASCII line (see `Scanner`)."""

    def __init__(self) -> None:
        super().__init__()
        self._cutter = AsciiCutter()

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the ASCII ADU of `pdu`; recent ones are cached."""
        return _encoded(unit, pdu)

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> list[Token]:
        """Take bytes, and return the completed frames; see `Scanner`."""
        end = self.position - len(self._cutter.begun)
        if damaged:
            self._damage = [each for each in self._damage if each[1] > end]
            self._damage.append((self.position, self.position + len(data)))
        self.position += len(data)
        tokens = []
        for before, text in self._cutter.cut(data, now):
            start, end = end + before, end + before + len(text)
            frame = decode(text)
            if text == self._sent and self._expected is not None and self._expected.since == NEVER and not early:
                self._expected.since = end
            if frame is not None:
                tokens.append(Token(start, end, now, frame, is_damaged=self._has_damage(start, end)))
        if early:
            self._came_early()
        return tokens

    @property
    def missing(self) -> int:
        """The least number of bytes needed. A colon may begin another frame at any time, perhaps an exception."""
        begun, expected = self._cutter.begun, self._expected
        if not begun or expected is None:
            return 0
        size = expected.asked.response_size
        head = START + expected.head.hex().upper().encode()
        if expected.answers_from is None or size is None or not begun.upper().startswith(head):
            return max(0, characters(SHORTEST) - len(begun))
        return max(0, min(characters(size + _OVERHEAD) - len(begun), characters(EXCEPTION_SIZE + _OVERHEAD)))

    def is_damaged(self, data: bytes, expected: Expected, *, shared: bool) -> bool:
        """Tell whether `data` looks like this response with a wrong LRC; one character of CR LF may be damaged.

        See `Scanner`.
        """
        text = plain(data).upper()
        size, odd = divmod(len(text) - characters(_OVERHEAD), 2)
        if odd or not expected.can_be_damaged(size, shared=shared):
            return False
        has_ended = text[-2:-1] == END[:1] or text[-1:] == END[1:]
        digits = expected.head_of(size).hex().upper().encode()
        return has_ended and text.startswith(START) and text.startswith(digits, len(START) + 2 * expected.skipped)

    def has_begun(self, data: bytes, head: bytes) -> bool:
        """Tell whether `data` contains the digits of `head`."""
        return head.hex().upper().encode() in plain(data).upper()
