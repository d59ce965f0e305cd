"""The scanner of an RTU line.

By the specification, silence separates RTU frames (S 2.5.1.1). Behind a USB adapter or a busy system it cannot be
measured: there are gaps in frames, and none between them. So a frame whose size is known, from the request or from its
own first bytes, ends on its last byte. Only a frame of an unknown function ends by silence, complete or not. A correct
CRC does not show that a frame is complete: one frame in 256 has a shorter one at its start.

A frame may begin anywhere, and be a request or a response. So each place is tried once as the beginning of either, and
the CRC is checked where that frame would end. A frame inside the expected response is held back until that ends: it may
be data.

Usually only the response comes. While all bytes since the request can be its beginning, nothing else is tried.
"""

import re
from collections.abc import Sequence
from heapq import heappop, heappush
from typing import Final, cast

from gateway.modbus import rtu
from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import request_size, response_size
from gateway.modbus.rtu import OVERHEAD, SHORTEST, crc_fits
from gateway.modbus.scan import EXCEPTION_SIZE, NEVER, Expected, Scanner, Token

#: The ADU of an exception response.
_EXCEPTION_ADU: Final = EXCEPTION_SIZE + OVERHEAD
#: On the idle line, a longer gap separates frames, in seconds.
HOLE: Final = 1.0
#: The readings of a frame.
_READINGS: Final = (request_size, response_size)
_RESPONSE: Final = 1
#: For each function code: the readings in which it tells a first size, with that size.
_FIRST_SIZES: Final = tuple(
    tuple((reading, size) for reading, pdu_size in enumerate(_READINGS) if (size := pdu_size(bytes((code,)))))
    for code in range(256)
)
#: Clients repeat the same few requests, so their ADUs are cached by unit and PDU: at most this many per unit.
_encoded: Final[tuple[dict[bytes, bytes], ...]] = tuple({} for _ in range(256))
_MOST_ENCODED: Final = 64
#: A unit identifier before a function code below 128 whose frames tell their size.
_BEGIN: Final = re.compile(
    b"(?s).(?=[" + re.escape(bytes(code for code in range(1, 128) if _FIRST_SIZES[code])) + b"])"
)
#: A whole exception response: its first two bytes occur too often in noise.
_EXCEPTION: Final = re.compile(b"(?s).(?=[\x80-\xff]...)")


class RtuScanner(Scanner):
    """Finds the frames on an RTU line (see `Scanner`)."""

    def __init__(self, silence: float = 0.0) -> None:
        super().__init__(silence)
        #: When the last byte was read, and the place of the last silence noticed.
        self._last = 0.0
        self._silent_at = 0
        #: The place of the request, and the size of its echo.
        self._sent_at: int
        self._echo_size: int
        #: The size of the response while all bytes can be its beginning, else 0; those bytes, and the size and time of
        #: their pieces.
        self._size = 0
        self._coming = b""
        self._pieces: list[tuple[int, float]] = []
        #: The last bytes before those, and the place after them. Possible frames, by end: end, start, reading.
        self._buffer = b""
        self._scanned = 0
        self._begun: list[tuple[int, int, int]] = []
        #: Frames in the buffer, and frames held back because they may be data of the response.
        self._found: list[Token] = []
        self._waiting: list[Token] = []

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the RTU ADU of `pdu`; recent ones are cached."""
        of_unit = _encoded[unit]
        adu = of_unit.get(pdu)
        if adu is None:
            if len(of_unit) >= _MOST_ENCODED:
                of_unit.clear()
            adu = of_unit[pdu] = rtu.encode(unit, pdu)
        return adu

    def expect(self, expected: Expected, sent: bytes, *, echoes: bool) -> None:
        """Expect this response; see `Scanner`."""
        super().expect(expected, sent, echoes=echoes)
        self._sent_at, self._echo_size = self.position, len(sent) if echoes else 0
        size = expected.asked.response_size
        self._size = 0 if size is None or expected.answers_from is None else size + OVERHEAD

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> list[Token]:
        """Take bytes, and return the completed frames; see `Scanner`."""
        if now - self._last > HOLE and self._expected is None:
            self._restart()
        self._last = now
        self.position += len(data)
        if self._size and not (damaged or early):
            return self._received_alone(data, now)
        size = self._size
        tokens = self._scan_again()
        if damaged:
            self._damage.append((self.position - len(data), self.position))
        if early:
            self._came_early()
        tokens += self._scan(data, now)
        if early:
            self._size = size
            if self._expected is not None and self._echo_size:
                self._sent_at, self._expected.since = self.position, NEVER  # that echo was not ours either
        return tokens

    def skip(self, size: int, now: float) -> None:
        """Pass over bytes that, with all before them, are known to be whole frames."""
        self._last = now
        self.position += size
        self._restart()

    @property
    def missing(self) -> int:
        """The least number of bytes that the response still needs; 0 if it has not begun."""
        come, expected = self._coming[self._echo_size :], self._expected
        if expected is None or not come:
            return 0
        return (_EXCEPTION_ADU if _can_begin(come, expected.exception_head) else self._size) - len(come)

    def deadline(self, expected: Expected) -> float | None:
        """Return when silence may end this response, or release frames held back because of it; see `Scanner`."""
        if expected.asked.response_size is not None or max(expected.since, self._silent_at) >= self.position:
            return None
        return None if expected.asked.longest_response and not self._waiting else self._last + self.silence

    def tick(self, now: float) -> list[Token]:
        """Return the frames that silence has ended, and those held back for a response of unknown size."""
        if self._silent_at == self.position or now < self._last + self.silence:
            return []
        unknown = [each for each in self._awaited() if not each.asked.longest_response]
        tokens = self._scan_again() if unknown else []
        if self._expected is not None and self._expected.asked.response_size is None:
            tokens += self._release(wait=False)
        ended = {at for each in unknown for at in self._starts(each) if self._ends_here(at)}
        self._silent_at = self.position
        return tokens + [self._token(at, len(self._buffer), self._last) for at in sorted(ended)]

    def end(self) -> tuple[Token, ...]:
        """End the request, and return the frames held back; see `Scanner`."""
        if not (self._coming or self._waiting):  # the usual case
            self._size = 0
            return super().end()
        tokens = self._scan_again() if self._coming else []
        if self._waiting:
            tokens, self._waiting = tokens + self._waiting, []
        self._size = 0
        return (*tokens, *super().end())

    def is_damaged(self, data: bytes, expected: Expected, *, shared: bool) -> bool:
        """Tell whether `data` looks like this response with a wrong CRC; see `Scanner`."""
        size = len(data) - OVERHEAD
        return expected.can_be_damaged(size, shared=shared) and data.startswith(
            expected.head_of(size), expected.skipped
        )

    def has_begun(self, data: bytes, head: bytes) -> bool:
        """Tell whether `data` contains `head`."""
        return head in data

    def ended_by_silence(self, units: set[int]) -> list[Frame]:
        """Return frames of unknown size from `units` that end with the last byte; see `Scanner`."""
        data = self._buffer
        places = [at for at in range(len(data)) if data[at] in units and not response_size(data[at + 1 :])]
        return [Frame(data[at], data[at + 1 : -2]) for at in places if self._ends_here(at)]

    def _received_alone(self, data: bytes, now: float) -> list[Token]:
        """Take bytes that can be the beginning of the response or the echo; if not, scan all of them."""
        if self._is_response(data) and not self._coming:
            return self._take_alone(data, now)
        self._coming = self._coming + data if self._coming else data
        self._pieces.append((len(data), now))
        come = self._coming
        if self._echo_size:
            if not _can_begin(come, self._sent):
                return self._scan_again()
            come = come[self._echo_size :]
        expected = cast("Expected", self._expected)
        if _can_begin(come, expected.head):
            size = self._size
        elif _can_begin(come, expected.exception_head):
            size = _EXCEPTION_ADU
        else:
            return self._scan_again()
        if len(come) < size:
            return []
        return self._take_alone(come, now) if len(come) == size and crc_fits(come) else self._scan_again()

    def _is_response(self, data: bytes) -> bool:
        """Tell whether `data` is exactly the normal response."""
        expected = self._expected
        if expected is None or self._echo_size or len(data) != self._size:
            return False
        return data.startswith(expected.head) and crc_fits(data)

    def _scan_again(self) -> list[Token]:
        """Scan the bytes that turned out not to be only the response."""
        self._size = 0
        coming, pieces, at = self._coming, self._pieces, 0
        self._coming, self._pieces = b"", []
        tokens: list[Token] = []
        for size, then in pieces:
            tokens += self._scan(coming[at : at + size], then)
            at += size
        return tokens

    def _take_alone(self, adu: bytes, now: float) -> list[Token]:
        """Take a response that came alone: whatever seemed to begin before it was not a frame."""
        self._restart()
        start = self.position - len(adu)
        if self._expected is not None:
            self._expected.since = start
        return [Token(start, self.position, now, Frame(adu[0], adu[1:-2]))]

    def _restart(self) -> None:
        """Forget all frames that have begun."""
        self._coming, self._scanned, self._size = b"", self.position, 0
        if self._pieces:
            self._pieces.clear()
        if self._buffer:
            self._buffer = b""
            self._begun.clear()
            self._found.clear()
            self._damage.clear()

    def _scan(self, data: bytes, now: float) -> list[Token]:
        """Find the frames that are complete with `data`, in pieces no larger than a frame."""
        tokens: list[Token] = []
        for at in range(0, len(data), MAX_RTU_ADU):
            tokens += self._scan_piece(data[at : at + MAX_RTU_ADU], now)
        return tokens

    def _scan_piece(self, data: bytes, now: float) -> list[Token]:
        """Find the frames that are complete with this piece."""
        known = len(self._buffer)
        self._buffer += data
        self._scanned += len(data)
        self._find_beginnings(known)
        ends = self._ended()
        for expected in self._awaited():
            ends |= self._exact(expected, known)
        ends |= self._copies(known)
        tokens = [self._token(start, end, now) for end, start in sorted(ends)]
        self._found += tokens
        self._waiting += tokens
        tokens = self._release(wait=True)
        self._buffer = self._buffer[-MAX_RTU_ADU:]
        if self._found:
            self._found = [each for each in self._found if each.end > self._offset]
        if self._damage:
            self._damage = [each for each in self._damage if each[1] > self._offset]
        return tokens

    def _find_beginnings(self, known: int) -> None:
        """Note where frames may begin after the `known` part of the buffer; exceptions once they are complete."""
        buffer, offset = self._buffer, self._offset
        for begin in _BEGIN.finditer(buffer, max(0, known - 1)):
            at = begin.start()
            for reading, size in _FIRST_SIZES[buffer[at + 1]]:
                heappush(self._begun, (offset + at + size + OVERHEAD, offset + at, reading))
        for begin in _EXCEPTION.finditer(buffer, max(0, known + 1 - _EXCEPTION_ADU)):
            at = begin.start()
            if crc_fits(buffer[at : at + _EXCEPTION_ADU]):
                heappush(self._begun, (offset + at + _EXCEPTION_ADU, offset + at, _RESPONSE))

    def _ended(self) -> set[tuple[int, int]]:
        """Find the ends and beginnings of complete frames. Frames that now tell a larger size are noted again."""
        ends = set()
        buffer, offset = self._buffer, self._offset
        while self._begun and self._begun[0][0] <= self._scanned:
            end, start, reading = heappop(self._begun)
            at = start - offset
            size = _READINGS[reading](buffer[at + 1 :])
            if start + size + OVERHEAD > end and size <= MAX_PDU:
                heappush(self._begun, (start + size + OVERHEAD, start, reading))
            elif start + size + OVERHEAD == end and crc_fits(buffer[at : end - offset]):
                ends.add((end - offset, at))
        return ends

    def _exact(self, expected: Expected, known: int) -> set[tuple[int, int]]:
        """Find complete frames of an expected response whose size is known from the request."""
        if expected.asked.response_size is None:
            return set()
        size = expected.asked.response_size + OVERHEAD
        places = [at for at in self._starts(expected, known + 1 - size) if at + size <= len(self._buffer)]
        return {(at + size, at) for at in places if crc_fits(self._buffer[at : at + size])}

    def _copies(self, known: int) -> set[tuple[int, int]]:
        """Find a copy of the request. If an echo is expected, the response comes after the first copy.

        A later copy may be the beginning of a response of unknown size; else it is found like any request.
        """
        expected, size = self._expected, len(self._sent)
        if expected is None:
            return set()
        at = self._buffer.find(self._sent, max(known + 1 - size, self._sent_at - self._offset, 0))
        if at < 0:
            return set()
        if expected.since == NEVER:
            expected.since = self._offset + at + size
        return set() if self._offset + at >= expected.since else {(at + size, at)}

    def _release(self, *, wait: bool) -> list[Token]:
        """Return the frames that cannot be payload of the expected response. `wait`: keep those that still may be."""
        waiting, self._waiting = self._waiting, []
        released: list[Token] = []
        response = self._find_response(0, wait=wait) if waiting else None
        while response is not None:
            start, end = response
            if end > self._scanned:
                self._waiting = [each for each in waiting if each.start > start]
                return released + [each for each in waiting if each.start <= start]
            released += [each for each in waiting if each.end <= start or (each.start, each.end) == (start, end)]
            waiting = [each for each in waiting if each.end > end]
            response = self._find_response(end, wait=wait)
        return released + waiting

    def _find_response(self, since: int, *, wait: bool) -> tuple[int, int] | None:
        """Find start and end of the first normal response after `since`, perhaps incomplete; None if there is none."""
        expected = self._expected
        if expected is None:
            return None
        for at in self._starts(expected, since - self._offset):
            start, size = self._offset + at, self._size_of(expected, at, wait=wait)
            if at + size > len(self._buffer):
                if wait and not any(frame.start < start < frame.end for frame in self._found):
                    return start, start + size
            elif expected.asked.longest_response:
                if crc_fits(self._buffer[at : at + size]):
                    return start, start + size
            elif size and self._ends_here(at):
                return start, start + size
        return None

    def _size_of(self, expected: Expected, at: int, *, wait: bool) -> int:
        """Return the size of the response that begins at `at`, as far as its bytes tell; 0 if no response can.

        `wait`: a response of unknown size counts as one byte longer than what was received.
        """
        if expected.asked.response_size is not None:
            return expected.asked.response_size + OVERHEAD
        longest = expected.asked.longest_response
        if not longest:
            rest = len(self._buffer) - at
            return (rest + 1 if wait else rest) if rest <= MAX_RTU_ADU else 0
        size = response_size(self._buffer[at + 1 :])
        return size + OVERHEAD if size <= longest else 0

    def _starts(self, expected: Expected, at: int = 0) -> list[int]:
        """Find where this response may begin in the buffer, from `at` on; of unknown size, after the last silence."""
        skipped, since = expected.skipped, expected.since
        if not expected.asked.longest_response:
            since = max(since, self._silent_at)
        found = self._buffer.find(expected.head, max(at, since - self._offset, 0) + skipped)
        starts = []
        while found >= 0:
            starts.append(found - skipped)
            found = self._buffer.find(expected.head, found + 1)
        return starts

    def _ends_here(self, at: int) -> bool:
        """Tell whether everything from `at` on is one frame; not if it ends with NUL: the CRC fits without it too."""
        adu = self._buffer[at:]
        return len(adu) >= SHORTEST and adu[-1] > 0 and crc_fits(adu)

    def _token(self, at: int, end: int, now: float) -> Token:
        """Make the token of the frame at this place of the buffer."""
        buffer, offset = self._buffer, self._offset
        start, stop = offset + at, offset + end
        frame = Frame(buffer[at], buffer[at + 1 : end - 2])
        return Token(start, stop, now, frame, is_damaged=self._has_damage(start, stop))

    def _awaited(self) -> Sequence[Expected]:
        return self.late if self._expected is None else [self._expected, *self.late]

    @property
    def _offset(self) -> int:
        """Place of the first byte in the buffer."""
        return self._scanned - len(self._buffer)


def _can_begin(data: bytes, head: bytes) -> bool:
    """Tell whether `data` can be the beginning of bytes that begin with `head`."""
    return data.startswith(head) if len(data) >= len(head) else head.startswith(data)
