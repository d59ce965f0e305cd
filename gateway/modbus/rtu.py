"""RTU framing (S 2.5.1): unit identifier, PDU, CRC; frames are parted by silence.

Who ends a frame. Silence is the rule of the specification, but behind a USB adapter or a scheduler it cannot be
measured: bytes of one frame arrive with holes, and two frames arrive glued. So a frame whose size can be foretold, by
the request or by its own first bytes, ends on its last byte, and holes do not matter. Only a frame of an unknown
function ends by silence. A CRC that fits is never a sign that a frame is complete: one frame in 256 has a prefix with a
fitting CRC.

This is the server's side: `RequestFramer` foretells the size of a request from its first bytes, and looks behind noise
once the line is silent. What a client hears is scanned in `scan_rtu`.
"""

from collections.abc import Callable, Container

from gateway.modbus.checks import crc_fits, with_crc
from gateway.modbus.codes import BROADCAST_UNIT, MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import request_size, response_size

#: The unit identifier before the PDU and the CRC behind it.
OVERHEAD = 3
#: The shortest frame: a PDU of one byte.
SHORTEST = OVERHEAD + 1
#: So many bytes before a frame can be what switching an RS-485 line leaves.
_GLITCH = 3

#: One of the functions of `foretell`.
Foretell = Callable[[bytes], int]


def encode(unit: int, pdu: bytes) -> bytes:
    """The RTU ADU of `pdu`."""
    return with_crc(bytes((unit,)) + pdu)


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


def _complete(data: bytes | bytearray, foretold: int) -> int:
    """Size of the ADU at the start of `data` when all of it is there, else 0; `foretold` is that of its PDU."""
    size = foretold + OVERHEAD
    return size if SHORTEST <= size <= min(len(data), MAX_RTU_ADU) else 0


def _is_whole(data: bytes) -> bool:
    """Whether all of `data` can be one frame: of an unknown function, or of a size that its function does not have.

    Nothing but the check sum tells that from the end of some noise.
    """
    return len(data) >= SHORTEST and crc_fits(data)
