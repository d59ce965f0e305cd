"""Cuts the bytes of a bus into what its senders have put on it, one behind the other: frames, and stretches of none.

A listener has asked nothing, so it does not know what comes. But frames follow each other: while the bytes behind the
last one may still become a whole frame, request or response, a frame that is found inside them is not taken, because it
may be their data. Where they cannot any more, they are a stretch that belongs to no frame, up to the next one.
"""

from binascii import Error as NotHexadecimal
from binascii import unhexlify
from typing import Final

from gateway.errors import RequestError
from gateway.modbus.ascii import END, START, plain
from gateway.modbus.codes import EXCEPTION_BIT, MAX_ASCII_ADU, MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import request_size, response_size
from gateway.modbus.pdu import can_be_read_both_ways, parse_sent
from gateway.modbus.rtu import OVERHEAD, SHORTEST, crc_fits, encode
from gateway.modbus.scan import Expected, Scanner, Token
from gateway.modbus.scan_ascii import AsciiScanner
from gateway.modbus.scan_rtu import HOLE, RtuScanner
from gateway.timing.characters import Mode

#: The most bytes kept of a stretch: two frames of the longest kind.
_KEPT: Final = {"rtu": 2 * MAX_RTU_ADU, "ascii": 2 * MAX_ASCII_ADU}
#: A driver that is switched on or off may leave up to this many bytes, each of them one pulse: a zero bit becomes ones.
_MOST_PULSES: Final = 3
#: A port with seven data bits reads them without the highest one.
_PULSES: Final = frozenset(ones << bits & ones for ones in (0xFF, 0x7F) for bits in range(9))


class Stretch:
    """`count` bytes that belong to no frame, from the place `start` on; the last ones were read `at`.

    `data` are all of them, or of very many the last ones. If it `is_glitch`, nobody has sent them: a driver was
    switched.
    """

    __slots__ = ("at", "count", "data", "is_glitch", "start")

    def __init__(self, start: int, count: int, data: bytes, at: float, *, is_glitch: bool) -> None:
        self.start = start
        self.count = count
        self.data = data
        self.at = at
        self.is_glitch = is_glitch

    @property
    def is_whole(self) -> bool:
        """Whether `data` are all of its bytes."""
        return self.count == len(self.data)


#: What follows each other on a bus.
Part = Token | Stretch


class Succession:
    """Cuts the bytes of one bus. `silence` ends a frame whose size is not known, in seconds (RTU)."""

    def __init__(self, mode: Mode, silence: float) -> None:
        self._is_ascii = mode == "ascii"
        self._scanner: Scanner = AsciiScanner() if self._is_ascii else RtuScanner()
        self._kept = _KEPT[mode]
        self._silence = silence
        #: The place behind the last part; the bytes that follow it, or the last ones of them.
        self._place = 0
        self._text = b""
        #: The place behind the last damaged byte; the unit that was asked last, until it answers.
        self._damaged_to = 0
        self._asked_unit: int | None = None
        #: Frames in these bytes that are not taken yet.
        self._found: list[Token] = []
        #: When the last byte was read, and whether the silence behind it was noticed.
        self._last = 0.0
        self._is_quiet = False

    @property
    def is_between(self) -> bool:
        """Whether nothing has begun: the last byte was the last one of a frame."""
        return not self._text

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Part]:
        """Take bytes. Return what is complete with them; a frame with a damaged byte is none."""
        parts = self._end() if self._text and now - self._last > HOLE else []
        self._last, self._is_quiet = now, False
        if damaged or len(data) <= MAX_RTU_ADU:
            self._take(data, now, parts, damaged=damaged)
        else:
            for at in range(0, len(data), MAX_RTU_ADU):
                self._take(data[at : at + MAX_RTU_ADU], now, parts)
        return parts

    def is_twofold(self, frame: Frame) -> bool:
        """Tell whether a frame may be a request or a response, perhaps with or without a NUL behind it."""
        pdu = frame.pdu
        if can_be_read_both_ways(pdu):
            return True
        if self._is_ascii or request_size(pdu) != len(pdu) + 1:
            return False
        try:
            parse_sent(encode(frame.unit, pdu)[1:-1])
        except RequestError:
            return False
        return True

    def is_damaged_answer(self, stretch: Stretch, asked: Expected) -> bool:
        """Tell whether a stretch behind a request looks like its answer with a wrong check sum, and like no request."""
        return stretch.is_whole and self._scanner.is_damaged(stretch.data, asked, shared=True)

    def is_damaged_request(self, stretch: Stretch, answer: Frame) -> bool:
        """Tell whether a stretch looks like a request with a wrong check sum that the frame behind it answers."""
        body = _body_in_ascii(stretch.data) if self._is_ascii else stretch.data[:-2]
        if not stretch.is_whole or len(body) < SHORTEST - 2 or body[0] != answer.unit:
            return False
        return body[1] == answer.pdu[0] & ~EXCEPTION_BIT and request_size(body[1:]) == len(body) - 1

    def deadline(self) -> float | None:
        """Return when silence ends what has begun; None if nothing has."""
        if not self._text:
            return None
        return self._last + (HOLE if self._is_quiet or self._is_ascii else self._silence)

    def tick(self, now: float) -> list[Part]:
        """Let time pass. Return what silence has ended: a frame of a function without a known size, or a stretch."""
        if not self._text:
            return []
        if now >= self._last + HOLE:
            return self._end()
        if not (self._is_quiet or self._is_ascii) and now >= self._last + self._silence:
            self._is_quiet = True
            if self._ends_here():
                text = self._text
                end = self._scanner.position
                token = Token(self._place, end, self._last, Frame(text[0], text[1:-2]))
                self._go_to(end)
                return [token]
        return []

    def _take(self, data: bytes, now: float, parts: list[Part], *, damaged: bool = False) -> None:
        """Add what is complete with these bytes to `parts`."""
        scanner = self._scanner
        self._text = self._text + data if self._text else data
        if damaged:
            self._damaged_to = scanner.position + len(data)
        if isinstance(scanner, RtuScanner) and not damaged:
            begun = self._take_whole(parts, scanner.position + len(data), now)
            if begun <= len(data):
                scanner.skip(len(data) - begun, now)
                data = self._text
                if not data:
                    return
        tokens = scanner.received(data, now, damaged=damaged)
        self._found += [each for each in tokens if each.start >= self._place and not each.is_damaged]
        while (token := self._next()) is not None:
            self._add(token, parts)
        if len(self._text) > self._kept:
            self._text = self._text[-self._kept :]

    def _take_whole(self, parts: list[Part], end: int, now: float) -> int:
        """Take whole frames off the beginning; return how many bytes are left of those before the place `end`.

        This is the usual case, and much faster than a scanner, which looks for frames at any place. NUL bytes behind a
        frame do not change its CRC: so a frame is read as an answer first if its unit was asked, else as a request.
        """
        text = self._text
        if len(text) != end - self._place or self._place < self._damaged_to:
            return len(text)
        while text:
            pdu = text[1 : MAX_PDU + 1]
            sizes = request_size(pdu), response_size(pdu)
            for known in sizes if text[0] != self._asked_unit else reversed(sizes):
                size = known + OVERHEAD
                if SHORTEST <= size <= min(len(text), MAX_RTU_ADU) and crc_fits(text[:size]):
                    break
            else:
                break
            start, self._place = self._place, self._place + size
            self._found = []
            self._append(Token(start, self._place, now, Frame(text[0], text[1 : size - 2])), parts)
            text = text[size:]
        self._text = text
        return len(text)

    def _append(self, token: Token, parts: list[Part]) -> None:
        """Append a frame to `parts`, and note whether an answer is next."""
        parts.append(token)
        unit, pdu = token.frame.unit, token.frame.pdu
        is_request = request_size(pdu) == len(pdu) and not (unit == self._asked_unit and response_size(pdu) == len(pdu))
        self._asked_unit = unit if is_request else None

    def _add(self, token: Token, parts: list[Part]) -> None:
        """Add a frame to `parts`, and what lies before it."""
        if token.start > self._place:
            parts.append(self._cut(token.start, token.at))
        self._append(token, parts)
        self._go_to(token.end)

    def _next(self) -> Token | None:
        """Return the frame to take next; None while the bytes before it may still become a larger one."""
        if not self._found:
            return None
        first = self._found[0]
        if first.start == self._place:
            return first
        nearest = min(self._found, key=lambda each: each.start)
        if nearest.start == self._place or self._is_glitch(nearest.start) or not self._may_become_whole():
            return nearest
        return None

    def _may_become_whole(self) -> bool:
        """Tell whether the bytes behind the last part can be the beginning of a frame."""
        size = len(self._text)
        if self._is_ascii or size > MAX_RTU_ADU or size < self._scanner.position - self._place:
            return False
        pdu = self._text[1:]
        for size_of in (request_size, response_size):
            whole = size_of(pdu)
            if 0 < whole <= MAX_PDU and whole + OVERHEAD > size:
                return True
        return False

    def _ends_here(self) -> bool:
        """Tell whether all bytes behind the last part are one frame that only silence ends; see `RtuScanner`."""
        text = self._text
        if not SHORTEST <= len(text) <= MAX_RTU_ADU or len(text) < self._scanner.position - self._place:
            return False
        pdu = text[1:]
        return 0 in (request_size(pdu), response_size(pdu)) and text[-1] > 0 and crc_fits(text)

    def _is_glitch(self, end: int) -> bool:
        """Tell whether nobody has sent the bytes up to this place."""
        count = end - self._place
        return count <= _MOST_PULSES and _PULSES.issuperset(self._text[:count])

    def _end(self) -> list[Part]:
        """End what has begun, because nothing has followed: frames that were found in it may be real ones."""
        parts: list[Part] = []
        while self._found:
            self._add(min(self._found, key=lambda each: each.start), parts)
        if self._text:
            parts.append(self._cut(self._scanner.position, self._last))
        return parts

    def _cut(self, end: int, at: float) -> Stretch:
        """Cut a stretch off, up to this place."""
        start, begun = self._place, self._scanner.position - len(self._text)
        data, is_glitch = self._text[: max(0, end - begun)], self._is_glitch(end)
        self._go_to(end)
        return Stretch(start, end - start, data, at, is_glitch=is_glitch)

    def _go_to(self, place: int) -> None:
        """Go on behind this place. What has begun before it is no frame any more."""
        begun = self._scanner.position - len(self._text)
        self._place = place
        self._text = self._text[place - begun :]
        if self._found:
            self._found = [each for each in self._found if each.start >= place]


def _body_in_ascii(text: bytes) -> bytes:
    """Return unit identifier and PDU of what looks like a frame, whatever its LRC; empty if nothing does."""
    text = plain(text)
    if not (text.startswith(START) and text.endswith(END)):
        return b""
    try:
        return unhexlify(text[len(START) : -len(END)])[:-1]
    except NotHexadecimal:
        return b""
