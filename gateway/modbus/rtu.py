"""RTU framing (S 2.5.1): unit identifier, PDU, CRC; frames are parted by silence.

Who ends a frame. Silence is the rule of the specification, but behind a USB adapter or a scheduler it cannot be
measured: bytes of one frame arrive with holes, and two frames arrive glued. So a frame whose size can be foretold, by
the request or by its own first bytes, ends on its last byte, and holes do not matter. Only a frame of an unknown
function ends by silence. A CRC that fits is never a sign that a frame is complete: one frame in 256 has a prefix with a
fitting CRC.

As the client, `ResponseFramer` knows what it asked and searches for exactly that, so noise around a response does not
lose it. As the server, `RequestFramer` foretells the size of a request from its first bytes, and looks behind noise
once the line is silent.
"""

from collections.abc import Callable, Container, Iterator

from gateway.modbus.checks import crc_fits, with_crc
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, MAX_PDU, MAX_RTU_ADU
from gateway.modbus.foretell import request_size, response_size
from gateway.modbus.frame import Frame
from gateway.modbus.passing import places
from gateway.modbus.pdu import RequestPdu

#: The unit identifier before the PDU and the CRC behind it.
OVERHEAD = 3
#: The shortest frame: a PDU of one byte.
_SHORTEST = OVERHEAD + 1
#: An exception response: a PDU of two bytes.
_EXCEPTION_SIZE = OVERHEAD + 2
#: Unit identifier and function code.
_HEAD_SIZE = 2
#: So many bytes before a frame can be what switching an RS-485 line leaves.
_GLITCH = 3

#: One of the functions of `foretell`.
Foretell = Callable[[bytes], int]


def encode(unit: int, pdu: bytes) -> bytes:
    """The RTU ADU of `pdu`."""
    return with_crc(bytes((unit,)) + pdu)


class ResponseFramer:
    """Finds the response to one request in what a line delivers.

    `silence` is how long the line must be quiet, in seconds, before a response of unknown size counts as complete.
    Noise may look like the beginning of a response that tells its own size: what is behind it counts after a silence.
    """

    def __init__(self, silence: float) -> None:
        self._silence = silence
        self._buffer = bytearray()
        self._head = b""
        self._refusal = b""
        self._unknown = 0
        self._size = 0
        self._longest = 0
        self._deadline: float | None = None
        #: No response begins before this place in the buffer: it would have all of some damaged bytes in it.
        self._sound_from = 0
        self.heard_noise = False

    encode = staticmethod(encode)

    @property
    def is_clean(self) -> bool:
        """Whether nothing but frames that were handed over has been received since `expect`."""
        return not (self.heard_noise or self._buffer)

    def expect(self, unit: int | None, asked: RequestPdu) -> None:
        """A request goes on the line: forget what was received, look for its response from `unit`, None from any."""
        self._buffer.clear()
        self._sound_from = 0
        self._deadline = None
        self.heard_noise = False
        known = b"" if unit is None else bytes((unit,))
        self._unknown = 1 - len(known)
        self._head = known + asked.response_head
        self._refusal = known + bytes((asked.function | EXCEPTION_BIT,))
        self._size = 0 if asked.response_size is None else asked.response_size + OVERHEAD
        self._longest = asked.longest_response + OVERHEAD if asked.longest_response else 0

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; what looks like the response, if it is complete with them.

        None has all of `damaged` ones in it.
        """
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        buffer = self._buffer
        buffer += data
        if not self._sound_from and len(buffer) == self._size and buffer.startswith(self._head, self._unknown):
            adu = bytes(buffer)
            if crc_fits(adu):  # as nearly always
                buffer.clear()
                return [Frame(adu[0], adu[1:-2])]
        frames = self._take()
        if len(buffer) > MAX_RTU_ADU:  # the response begins later
            self._sound_from = max(0, self._sound_from - len(buffer) + MAX_RTU_ADU)
            del buffer[:-MAX_RTU_ADU]
            self.heard_noise = True
        self._deadline = now + self._silence if self._is_undecided() else None
        return frames

    @property
    def missing(self) -> int:
        """So many bytes must come before there can be a response; 0 when nothing has begun, or that is not known."""
        here = len(self._buffer)
        if not (here and self._size) or self._sound_from:
            return 0
        if self._buffer.startswith(self._head, self._unknown):
            return max(0, self._size - here)
        return max(0, _EXCEPTION_SIZE - here)

    def deadline(self) -> float | None:
        """When silence ends a response of unknown size, or tells noise from one that tells its own; else None."""
        return self._deadline

    def tick(self, now: float) -> list[Frame]:
        """Let time pass; what looks like the response, if silence has shown that it is complete."""
        if self._deadline is None or now < self._deadline:
            return []
        self._deadline = None
        return self._take(patient=False)

    def conclude(self) -> list[Frame]:
        """No more is awaited: well-formed frames of other units or functions that were passed over. Changes nothing."""
        frames = responses_in(bytes(self._buffer[self._sound_from :]))
        heard = sum(len(frame.pdu) + OVERHEAD for frame in frames)
        self.heard_noise = self.heard_noise or heard < len(self._buffer)
        return frames

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """A response may end before the last of them, or begin behind the first."""
        frames = self.received(data, now)
        self._sound_from = max(self._sound_from, len(self._buffer) - len(data) + 1)
        return frames + self.received(last, now)

    def _is_undecided(self) -> bool:
        """Whether silence will show more: there is a response of unknown size, or something behind a beginning."""
        if self._size or not self._buffer:
            return False
        return not self._longest or self._find(patient=False) is not None

    def _take(self, *, patient: bool = True) -> list[Frame]:
        """Cut out all frames that may be the response."""
        frames = []
        while self._buffer and (place := self._find(patient=patient)) is not None:
            frames.append(self._cut(*place))
        return frames

    def _find(self, *, patient: bool) -> tuple[int, int] | None:
        """Place and size of the first frame that may be the response, normal or exception.

        Who is patient looks at nothing behind the beginning of a response that is still coming: it may be its data.
        """
        response, size, coming = self._find_response(patient=patient)
        if 0 <= response < _EXCEPTION_SIZE:
            return response, size
        refusal = self._find_refusal(response - _EXCEPTION_SIZE + _HEAD_SIZE if response > 0 else coming)
        if refusal >= 0:
            return refusal, _EXCEPTION_SIZE
        return (response, size) if response > 0 else None

    def _find_response(self, *, patient: bool) -> tuple[int, int, int | None]:
        """Place and size of the first normal response, -1 if there is none; where one begins that is still coming."""
        buffer = self._buffer
        found = buffer.find(self._head, self._sound_from + self._unknown)
        while found >= 0:
            at = found - self._unknown
            size = self._size_of(at, patient=patient)
            if at + size > len(buffer):
                if patient and not self._is_inside_a_frame(at):
                    return -1, 0, found
            elif size >= _SHORTEST and self._is_frame(bytes(buffer[at : at + size])):
                return at, size, None
            found = buffer.find(self._head, found + 1)
        return -1, 0, None

    def _size_of(self, at: int, *, patient: bool) -> int:
        """Size of the response that begins at `at`, or how much of it must be there to tell; 0 if there can be none."""
        if self._size:
            return self._size
        if self._longest:
            size = response_size(bytes(self._buffer[at + 1 : at + self._longest])) + OVERHEAD
            return size if size <= self._longest else 0
        rest = len(self._buffer) - at
        return rest + patient if rest <= MAX_RTU_ADU else 0  # while it is not silent, there may be more

    def _is_frame(self, adu: bytes) -> bool:
        """Whether the CRC fits. Where silence ends the frame it would fit without a NUL at the end too: undecided."""
        return crc_fits(adu) and bool(self._size or self._longest or adu[-1])

    def _is_inside_a_frame(self, at: int) -> bool:
        """Whether what stands at `at` is the data of a frame that began earlier and is complete."""
        return at > 0 and any(start < at < end for start, end in places(bytes(self._buffer)))

    def _find_refusal(self, end: int | None) -> int:
        """Where the first exception begins whose head stands before `end`, or -1."""
        buffer = self._buffer
        found = buffer.find(self._refusal, self._sound_from + self._unknown, end)
        while found >= 0:
            at = found - self._unknown
            adu = bytes(buffer[at : at + _EXCEPTION_SIZE])
            if len(adu) == _EXCEPTION_SIZE and crc_fits(adu):
                return at
            found = buffer.find(self._refusal, found + 1, end)
        return -1

    def _cut(self, at: int, size: int) -> Frame:
        """Take the frame out, and forget what is before it."""
        adu = bytes(self._buffer[at : at + size])
        self.heard_noise = self.heard_noise or at > 0
        del self._buffer[: at + size]
        self._sound_from = 0
        return Frame(adu[0], adu[1:-2])


class RequestFramer:
    """Cuts requests out of what a line delivers when we are a server on it.

    `silence` is the time without a byte, in seconds, after which a frame has ended (t3.5, or what the devices need).
    `ours` are the units that we answer for; None: every one. The others on the line answer too, and a response begins
    like a request of another size: a frame for another unit is read as both, and what fits is handed over, so that its
    end is known and the next request begins there. What follows a request to another unit is its response.
    """

    def __init__(self, silence: float, ours: Container[int] | None = None) -> None:
        self._silence = silence
        self._ours = ours
        self._buffer = bytearray()
        self._deadline: float | None = None
        self._asked_unit: int | None = None
        self._passed_over = 0
        self.heard_noise = False

    encode = staticmethod(encode)

    @property
    def unfinished(self) -> int:
        """Bytes that are no complete frame yet."""
        return len(self._buffer)

    @property
    def behind(self) -> int:
        """Bytes since the last frame."""
        return self._passed_over + len(self._buffer)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes that became readable at `now`; requests that are complete with them, in order.

        None has all of `damaged` ones in it.
        """
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        self._buffer += data
        frames = self._take_complete()
        while len(self._buffer) > MAX_RTU_ADU:  # no frame is so long: it begins with noise
            del self._buffer[0]
            self._pass_over()
            frames += self._take_complete()
        self._deadline = now + self._silence if self._buffer else None
        return frames

    def deadline(self) -> float | None:
        """When silence ends the frame that is being received, or None."""
        return self._deadline

    def tick(self, now: float) -> list[Frame]:
        """Let time pass; requests that silence has ended, those behind noise included."""
        if self._deadline is None or now < self._deadline:
            return []
        data, self._deadline = bytes(self._buffer), None
        self._buffer.clear()
        frames, at, end = [], 0, 0
        while at < len(data):
            size = self._size(data[at:], has_ended=True)
            if not size and at - end <= _GLITCH and _is_whole(data[at:]):
                size = len(data) - at
            if size:
                self._passed_over = 0
                frames.append(Frame(data[at], data[at + 1 : at + size - 2]))
                at = end = at + size
            else:
                self._pass_over()
                at += 1
        return frames

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """A request may end before the last of them, or begin behind the first."""
        frames = self.received(data, now)
        self._buffer += last
        begun = len(self._buffer) - len(data)
        if begun > 0:
            self._pass_over(begun)
            del self._buffer[:begun]
        return frames + self.received(b"", now)

    def _pass_over(self, count: int = 1) -> None:
        self._passed_over += count
        self.heard_noise = True

    def _take_complete(self) -> list[Frame]:
        frames = []
        while (size := self._size(self._buffer, has_ended=False)) > 0:
            frames.append(Frame(self._buffer[0], bytes(self._buffer[1 : size - 2])))
            del self._buffer[:size]
            self._passed_over = 0
        return frames

    def _size(self, data: bytes | bytearray, *, has_ended: bool) -> int:
        """Size of the frame at the start of `data`; 0 while there is none.

        The check sum alone does not tell the two ways to read a frame apart: it fits with a NUL behind a frame too. So
        the less likely one counts only when the other is out of the question.
        """
        pdu = bytes(data[1 : MAX_PDU + 1])
        for foretell in self._readings(data):
            foretold = foretell(pdu)
            size = _complete(data, foretold)
            if size and crc_fits(bytes(data[:size])):
                self._asked_unit = data[0] if foretell is request_size else None
                return size
            if not size and not has_ended and foretold:
                return 0
        return 0

    def _readings(self, data: bytes | bytearray) -> tuple[Foretell, ...]:
        """How to read a frame that begins with `data`, the likelier way first."""
        unit = data[0] if data else BROADCAST_UNIT
        if self._ours is None or unit == BROADCAST_UNIT or unit in self._ours:
            return (request_size,)
        return (response_size, request_size) if unit == self._asked_unit else (request_size, response_size)


def responses_in(data: bytes) -> list[Frame]:
    """The frames in `data` that read as responses, noise between them left out."""
    return list(_frames(data, response_size))


def ended_by_silence(data: bytes, units: Container[int]) -> list[Frame]:
    """The frames of unknown size from one of `units` that `data` ends with, wherever they begin, if it is silent."""
    starts = [at for at in range(len(data) - _SHORTEST + 1) if data[at] in units]
    return [
        Frame(data[at], data[at + 1 : -2]) for at in starts if not response_size(data[at + 1 :]) and crc_fits(data[at:])
    ]


def _complete(data: bytes | bytearray, foretold: int) -> int:
    """Size of the ADU at the start of `data` when all of it is there, else 0; `foretold` is that of its PDU."""
    size = foretold + OVERHEAD
    return size if _SHORTEST <= size <= min(len(data), MAX_RTU_ADU) else 0


def _is_whole(data: bytes) -> bool:
    """Whether all of `data` can be one frame: of an unknown function, or of a size that its function does not have.

    Nothing but the check sum tells that from the end of some noise.
    """
    return len(data) >= _SHORTEST and crc_fits(data)


def _frames(data: bytes, foretell: Foretell) -> Iterator[Frame]:
    """The frames in `data`, which silence has ended, noise between them left out."""
    at = 0
    while at + _SHORTEST <= len(data):
        frame = _first(data[at:], foretell)
        if frame is None:
            at += 1
        else:
            yield frame
            at += len(frame.pdu) + OVERHEAD


def _first(data: bytes, foretell: Foretell) -> Frame | None:
    """The frame at the start of `data`, which silence has ended: of foretold size, or of unknown size up to the end."""
    foretold = foretell(data[1 : MAX_PDU + 1])
    size = _complete(data, foretold) if foretold else len(data)
    if size < _SHORTEST or not crc_fits(data[:size]):
        return None
    return Frame(data[0], data[1 : size - 2])
