"""RTU framing of a server (S 2.5.1): unit identifier, PDU, CRC; silence between frames.

A frame of a known function ends on its last byte, whatever gaps it has; `scan_rtu`, for clients, says why.
"""

from collections.abc import Callable, Container
from typing import Final

from fastcrc import crc16 as _crc16

from gateway.modbus.codes import BROADCAST_UNIT, MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame, RequestFramer
from gateway.modbus.functions import request_size, response_size

#: The unit identifier before the PDU and the CRC after it.
OVERHEAD = 3
#: The shortest frame: a PDU of one byte.
SHORTEST = OVERHEAD + 1
#: Switching the direction of an RS-485 line may leave this many bytes before a frame.
_GLITCH = 3

_modbus_crc: Final = _crc16.modbus


def crc16(data: bytes) -> int:
    """Compute the CRC-16 of `data` (S 2.5.1.2): initial FFFF, polynomial A001 reflected. Its low byte goes first."""
    return _modbus_crc(data)


def with_crc(data: bytes) -> bytes:
    """Append the CRC of `data`, low byte first."""
    return data + crc16(data).to_bytes(2, "little")


def crc_fits(frame: bytes) -> bool:
    """Tell whether a frame ends with its CRC: the CRC over the whole frame is then zero."""
    return crc16(frame) == 0


def encode(unit: int, pdu: bytes) -> bytes:
    """Encode the RTU ADU of `pdu`."""
    return with_crc(bytes((unit,)) + pdu)


class RtuFramer(RequestFramer):
    """Finds requests on an RTU line (see RequestFramer).

    `silence` ends a frame, in seconds: t3.5, or what the devices need. `ours` are the units that the gateway answers
    for; None for all. Responses of other units are on the line too, and may begin like a request of another size. So a
    frame of another unit is read as both, and the next request begins where the one that fits ends.
    """

    def __init__(self, silence: float, ours: Container[int] | None = None) -> None:
        super().__init__()
        self._silence = silence
        self._ours = ours
        self._buffer = bytearray()
        self._deadline: float | None = None
        #: The unit of the last request; its response comes next.
        self._asked_unit: int | None = None

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the RTU ADU of `pdu`."""
        return encode(unit, pdu)

    @property
    def unfinished(self) -> int:
        """Bytes of an incomplete frame."""
        return len(self._buffer)

    def received(self, data: bytes, now: float, *, damaged: bool = False) -> list[Frame]:
        """Take bytes, and return the completed frames; see RequestFramer."""
        if damaged:
            return self._received_damaged(data[:-1], data[-1:], now)
        self._buffer += data
        frames = self._take_complete()
        while len(self._buffer) > MAX_RTU_ADU:  # longer than any frame: it begins with noise
            del self._buffer[0]
            self._skip(1)
            frames += self._take_complete()
        self._deadline = now + self._silence if self._buffer else None
        return frames

    def deadline(self) -> float | None:
        """Return when silence ends what was received; None if nothing is unfinished."""
        return self._deadline

    def tick(self, now: float) -> list[Frame]:
        """Return the frames that silence has ended, also those after noise."""
        if self._deadline is None or now < self._deadline:
            return []
        data, self._deadline = bytes(self._buffer), None
        self._buffer.clear()
        frames, at, end = [], 0, 0
        while at < len(data):
            rest = data[at:]
            size = self._size(rest, has_ended=True)
            # A frame of unknown function or size: only its CRC tells it from the end of noise.
            if not size and at - end <= _GLITCH and len(rest) >= SHORTEST and crc_fits(rest):
                size = len(rest)
            if size:
                self._skipped = 0
                frames.append(Frame(rest[0], rest[1 : size - 2]))
                at = end = at + size
            else:
                self._skip(1)
                at += 1
        return frames

    def _received_damaged(self, data: bytes, last: bytes, now: float) -> list[Frame]:
        """Take damaged bytes: a request may end before the last of them, or begin after the first."""
        frames = self.received(data, now)
        self._buffer += last
        begun = len(self._buffer) - len(data)
        if begun > 0:
            self._skip(begun)
            del self._buffer[:begun]
        return frames + self.received(b"", now)

    def _take_complete(self) -> list[Frame]:
        frames = []
        while (size := self._size(self._buffer, has_ended=False)) > 0:
            frames.append(Frame(self._buffer[0], bytes(self._buffer[1 : size - 2])))
            del self._buffer[:size]
            self._skipped = 0
        return frames

    def _size(self, data: bytes | bytearray, *, has_ended: bool) -> int:
        """Find the size of the frame at the start of `data`; 0 if there is none yet.

        The CRC alone does not decide between request and response: it also fits with a NUL after a frame. So the less
        likely reading counts only once the other one is impossible.
        """
        pdu = bytes(data[1 : MAX_PDU + 1])
        for pdu_size in self._readings(data):
            known = pdu_size(pdu)
            size = known + OVERHEAD
            is_complete = SHORTEST <= size <= min(len(data), MAX_RTU_ADU)
            if is_complete and crc_fits(bytes(data[:size])):
                self._asked_unit = data[0] if pdu_size is request_size else None
                return size
            if not is_complete and not has_ended and known:
                return 0
        return 0

    def _readings(self, data: bytes | bytearray) -> tuple[Callable[[bytes], int], ...]:
        """Choose how to read a frame that begins with `data`, the more likely reading first."""
        unit = data[0] if data else BROADCAST_UNIT
        if self._ours is None or unit == BROADCAST_UNIT or unit in self._ours:
            return (request_size,)
        return (response_size, request_size) if unit == self._asked_unit else (request_size, response_size)
