"""The scanner of an RTU line.

Silence parts RTU frames by the specification (S 2.5.1.1), but behind a USB adapter or a scheduler it cannot be
measured: bytes of one frame arrive with holes, and two frames arrive glued. So a frame whose size can be foretold, by
the request or by its own first bytes, ends on its last byte, and holes do not matter. Only a frame of an unknown
function ends by silence. A CRC that fits is never a sign that a frame is complete: one frame in 256 has a prefix with
a fitting CRC.

Nothing says where a frame begins, and whether it is a request or a response. So each place is looked at as the
beginning of either, once; then where a frame that may have begun there should end. What stands inside of the awaited
answer waits for the end of that: it may be its data.

The answer nearly always comes alone. As long as all that has come since the request can be its beginning, nobody looks
any further.
"""

import re
from heapq import heappop, heappush
from typing import Final, cast

from gateway.modbus import rtu
from gateway.modbus.checks import crc_fits
from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import request_size, response_size
from gateway.modbus.rtu import OVERHEAD, SHORTEST
from gateway.modbus.scan import EXCEPTION_SIZE, NEVER, Expected, Scanner, Token

#: The ADU of an exception response.
_EXCEPTION_ADU: Final = EXCEPTION_SIZE + OVERHEAD
#: Bytes that are parted by a longer hole, in seconds, belong to different frames if none is awaited.
HOLE: Final = 1.0
#: How a frame may be read.
_READINGS: Final = (request_size, response_size)
_RESPONSE: Final = 1
#: For each function code: each reading that tells its size, and what that is as far as the function tells it.
_FIRST_SIZES: Final = tuple(
    tuple((reading, size) for reading, foretell in enumerate(_READINGS) if (size := foretell(bytes((code,)))))
    for code in range(256)
)
#: A unit identifier, and behind it a function other than an exception whose frames tell their size.
_BEGIN: Final = re.compile(
    b"(?s).(?=[" + re.escape(bytes(code for code in range(1, 128) if _FIRST_SIZES[code])) + b"])"
)
#: All of what may be an exception. Half of all noise looks like its beginning.
_EXCEPTION: Final = re.compile(b"(?s).(?=[\x80-\xff]...)")


class RtuScanner(Scanner):
    """See `Scanner`."""

    def __init__(self, silence: float = 0.0) -> None:
        super().__init__(silence)
        #: When the last byte was read, and whether the silence behind it is over.
        self._last = 0.0
        self._is_silent = True
        #: The place of what was sent, and how much of it comes back before the answer.
        self._sent_at = 0
        self._echo_size = 0
        #: The size of the answer as long as nothing but its beginning can have come, else 0; that, in its pieces.
        self._size = 0
        self._coming = b""
        self._pieces: list[tuple[int, float]] = []
        #: What came last before that, and how much has come up to its end. In the order of their ends: where frames
        #: should end, where they would have begun, and how they are read.
        self._buffer = b""
        self._scanned = 0
        self._begun: list[tuple[int, int, int]] = []
        #: Frames in the buffer, and those that may be data of the answer.
        self._found: list[Token] = []
        self._waiting: list[Token] = []

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """See `Scanner`."""
        return rtu.encode(unit, pdu)

    def expect(self, expected: Expected, sent: bytes, *, echoes: bool) -> None:
        """See `Scanner`."""
        super().expect(expected, sent, echoes=echoes)
        self._sent_at, self._echo_size = self.position, len(sent) if echoes else 0
        size = expected.asked.response_size
        self._size = 0 if size is None or expected.unit is None else size + OVERHEAD

    def received(self, data: bytes, now: float, *, damaged: bool = False, early: bool = False) -> list[Token]:
        """See `Scanner`."""
        if now - self._last > HOLE and self._expected is None:
            self._restart()
        self._last, self._is_silent = now, False
        self.position += len(data)
        if self._size and not (damaged or early):
            return self._received_alone(data, now)
        size = self._size if early else 0
        tokens = self._look_back()
        if damaged:
            self._damage.append((self.position - len(data), self.position))
        if early:
            self._came_early()
        tokens += self._scan(data, now)
        if early:
            self._size = size
            if self._expected is not None and self._echo_size:
                self._sent_at, self._expected.since = self.position, NEVER  # nor was that echo ours
        return tokens

    @property
    def missing(self) -> int:
        """See `Scanner`."""
        come, expected = self._coming[self._echo_size :], self._expected
        if expected is None or not come:
            return 0
        is_response = _can_begin(come, expected.head)
        is_exception = _can_begin(come, expected.exception_head)
        return (_EXCEPTION_ADU if is_exception else self._size) - len(come) if is_response or is_exception else 0

    def deadline(self, expected: Expected) -> float | None:
        """See `Scanner`. A response that tells its own size may have begun in noise: what is behind that counts too."""
        if self._is_silent or expected.asked.response_size is not None or expected.since >= self.position:
            return None
        return None if expected.asked.longest_response and not self._waiting else self._last + self.silence

    def tick(self, now: float) -> list[Token]:
        """See `Scanner`."""
        if self._is_silent or now < self._last + self.silence:
            return []
        self._is_silent = True
        unknown = [each for each in self._awaited() if not each.asked.longest_response]
        tokens = self._look_back() if unknown else []
        if self._expected is not None and self._expected.asked.response_size is None:
            tokens += self._release(patient=False)
        ended = {at for each in unknown for at in self._starts(each) if self._ends_here(at)}
        return tokens + [self._token(at, len(self._buffer), self._last) for at in sorted(ended)]

    def end(self) -> list[Token]:
        """See `Scanner`."""
        tokens = self._look_back() if self._coming else []
        if self._waiting:
            tokens, self._waiting = tokens + self._waiting, []
        self._size = 0
        return tokens + super().end()

    def is_damaged(self, data: bytes, expected: Expected) -> bool:
        """See `Scanner`."""
        size = len(data) - OVERHEAD
        return expected.can_be_damaged(size) and data.startswith(expected.head_of(size), expected.skipped)

    def has_begun(self, data: bytes, head: bytes) -> bool:
        """See `Scanner`."""
        return head in data

    def ended_by_silence(self, units: set[int]) -> list[Frame]:
        """See `Scanner`."""
        data = self._buffer
        places = [at for at in range(len(data)) if data[at] in units and not response_size(data[at + 1 :])]
        return [Frame(data[at], data[at + 1 : -2]) for at in places if self._ends_here(at)]

    def _received_alone(self, data: bytes, now: float) -> list[Token]:
        """Take bytes as long as they can be the beginning of the answer, or its echo; or look at all of them."""
        self._coming += data
        self._pieces.append((len(data), now))
        come = self._coming
        if self._echo_size:
            if not _can_begin(come, self._sent):
                return self._look_back()
            come = come[self._echo_size :]
        expected = cast("Expected", self._expected)
        if _can_begin(come, expected.head):
            size = self._size
        elif _can_begin(come, expected.exception_head):
            size = _EXCEPTION_ADU
        else:
            return self._look_back()
        if len(come) < size:
            return []
        return self._take_alone(come, now) if len(come) == size and crc_fits(come) else self._look_back()

    def _look_back(self) -> list[Token]:
        """Find the frames in what might have been the answer alone."""
        self._size = 0
        coming, pieces, at = self._coming, self._pieces, 0
        self._coming, self._pieces = b"", []
        tokens: list[Token] = []
        for size, then in pieces:
            tokens += self._scan(coming[at : at + size], then)
            at += size
        return tokens

    def _take_alone(self, adu: bytes, now: float) -> list[Token]:
        """The answer is there, and nothing else: whatever seemed to begin before was no frame."""
        self._restart()
        start = self.position - len(adu)
        if self._expected is not None:
            self._expected.since = start
        return [Token(start, self.position, now, Frame(adu[0], adu[1:-2]))]

    def _restart(self) -> None:
        """Nothing that has come belongs to what comes."""
        self._coming, self._scanned, self._size = b"", self.position, 0
        self._pieces.clear()
        if self._buffer:
            self._buffer = b""
            self._begun.clear()
            self._found.clear()
            self._damage.clear()

    def _scan(self, data: bytes, now: float) -> list[Token]:
        """Find the frames that are complete with `data`, as if no more came at once than a frame has."""
        tokens: list[Token] = []
        for at in range(0, len(data), MAX_RTU_ADU):
            tokens += self._scan_piece(data[at : at + MAX_RTU_ADU], now)
        return tokens

    def _scan_piece(self, data: bytes, now: float) -> list[Token]:
        """Find the frames that are complete with so much."""
        known = len(self._buffer)
        self._buffer += data
        self._scanned += len(data)
        self._look_for_beginnings(known)
        ends = self._ended()
        for expected in self._awaited():
            ends |= self._exact(expected, known)
        ends |= self._copies(known)
        tokens = [self._token(start, end, now) for end, start in sorted(ends)]
        self._found += tokens
        self._waiting += tokens
        tokens = self._release(patient=True)
        self._buffer = self._buffer[-MAX_RTU_ADU:]
        self._forget()
        return tokens

    def _look_for_beginnings(self, known: int) -> None:
        """Note where frames may begin; so much of the buffer is known. Exceptions are noted once they are complete."""
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
        """Where frames have ended and begun in the buffer. What has told more of its size meanwhile is noted anew."""
        ends = set()
        buffer, offset = self._buffer, self._offset
        while self._begun and self._begun[0][0] <= self._scanned:
            end, start, reading = heappop(self._begun)
            at = start - offset
            size = _READINGS[reading](buffer[at + 1 : at + 1 + MAX_PDU])
            if start + size + OVERHEAD > end and size <= MAX_PDU:
                heappush(self._begun, (start + size + OVERHEAD, start, reading))
            elif start + size + OVERHEAD == end and crc_fits(buffer[at : end - offset]):
                ends.add((end - offset, at))
        return ends

    def _exact(self, expected: Expected, known: int) -> set[tuple[int, int]]:
        """The same of an awaited answer whose request tells the size, as its first bytes may not."""
        if expected.asked.response_size is None:
            return set()
        size = expected.asked.response_size + OVERHEAD
        places = [at for at in self._starts(expected, known + 1 - size) if at + size <= len(self._buffer)]
        return {(at + size, at) for at in places if crc_fits(self._buffer[at : at + size])}

    def _copies(self, known: int) -> set[tuple[int, int]]:
        """The same of a copy of what was sent. Where one is known to come, the answer comes behind the first.

        One that may be the beginning of an answer of unknown size is none before silence has ended it.
        """
        expected, size = self._expected, len(self._sent)
        if expected is None:
            return set()
        at = self._buffer.find(self._sent, max(known + 1 - size, self._sent_at - self._offset, 0))
        if at < 0:
            return set()
        if expected.since == NEVER:
            expected.since = self._offset + at + size
        is_answer = self._offset + at >= expected.since and not expected.asked.longest_response
        return set() if is_answer else {(at + size, at)}

    def _release(self, *, patient: bool) -> list[Token]:
        """The frames that are no data of the answer. Who is patient lets those wait that may be."""
        waiting, self._waiting = self._waiting, []
        released: list[Token] = []
        start, end = self._find_answer(0, patient=patient) if waiting else (-1, -1)
        while start >= 0:
            if end > self._scanned:
                self._waiting = [each for each in waiting if each.start > start]
                return released + [each for each in waiting if each.start <= start]
            released += [each for each in waiting if each.end <= start or (each.start, each.end) == (start, end)]
            waiting = [each for each in waiting if each.end > end]
            start, end = self._find_answer(end, patient=patient)
        return released + waiting

    def _find_answer(self, since: int, *, patient: bool) -> tuple[int, int]:
        """Where the first normal response begins and ends, behind `since`; -1 without one. It may be still coming."""
        expected = self._expected
        if expected is None:
            return -1, -1
        for at in self._starts(expected, since - self._offset):
            start, size = self._offset + at, self._size_of(expected, at, patient=patient)
            if at + size > len(self._buffer):
                if patient and not any(frame.start < start < frame.end for frame in self._found):
                    return start, start + size
            elif expected.asked.longest_response:
                if size >= SHORTEST and crc_fits(self._buffer[at : at + size]):
                    return start, start + size
            elif size and self._ends_here(at):
                return start, start + size
        return -1, -1

    def _size_of(self, expected: Expected, at: int, *, patient: bool) -> int:
        """Size of the response that begins at `at`, or how much of it must be there to tell; 0 if there can be none."""
        if expected.asked.response_size is not None:
            return expected.asked.response_size + OVERHEAD
        longest = expected.asked.longest_response
        if not longest:
            rest = len(self._buffer) - at
            return rest + patient if rest <= MAX_RTU_ADU else 0
        size = response_size(self._buffer[at + 1 : at + 1 + longest])
        return size + OVERHEAD if 0 < size <= longest else 0

    def _starts(self, expected: Expected, at: int = 0) -> list[int]:
        """Where the awaited answer may begin in the buffer, from `at` on."""
        skipped = expected.skipped
        found = self._buffer.find(expected.head, max(at, expected.since - self._offset, 0) + skipped)
        starts = []
        while found >= 0:
            starts.append(found - skipped)
            found = self._buffer.find(expected.head, found + 1)
        return starts

    def _ends_here(self, at: int) -> bool:
        """Whether all from `at` on is a frame. Its CRC would fit without a NUL at the end too: that is undecided."""
        adu = self._buffer[at:]
        return len(adu) >= SHORTEST and adu[-1] > 0 and crc_fits(adu)

    def _token(self, at: int, end: int, now: float) -> Token:
        """The frame at this place of the buffer."""
        buffer, offset = self._buffer, self._offset
        start, stop = offset + at, offset + end
        frame = Frame(buffer[at], buffer[at + 1 : end - 2])
        return Token(start, stop, now, frame, is_damaged=self._has_damage(start, stop))

    def _awaited(self) -> list[Expected]:
        return self.late if self._expected is None else [self._expected, *self.late]

    @property
    def _offset(self) -> int:
        """How much has come before the buffer."""
        return self._scanned - len(self._buffer)

    def _forget(self) -> None:
        """Forget the places of what is not in the buffer any more."""
        if self._found:
            self._found = [each for each in self._found if each.end > self._offset]
        if self._damage:
            self._damage = [each for each in self._damage if each[1] > self._offset]


def _can_begin(data: bytes, head: bytes) -> bool:
    """Whether `data` can be the beginning of something that begins with `head`."""
    return data.startswith(head) if len(data) >= len(head) else head.startswith(data)
