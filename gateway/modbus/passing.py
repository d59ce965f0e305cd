"""The RTU frames that pass on a line, whoever sends them: for those who listen without having asked.

Nobody says whether a frame is a request or a response, and noise, halves and holes stand between them. So each place is
looked at as the beginning of either, and a frame is found when its last byte is there and its CRC fits.
"""

import re
from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Final

from gateway.modbus.checks import crc_fits
from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.foretell import request_size, response_size
from gateway.modbus.frame import Frame

#: The unit identifier before the PDU and the CRC behind it.
_OVERHEAD: Final = 3
#: An exception response: with a PDU of two bytes.
_REFUSAL_SIZE: Final = 2 + _OVERHEAD
#: How a frame may be read.
_READINGS: Final = (request_size, response_size)
_RESPONSE: Final = 1
#: For each function code: each reading that tells its size, and what that is as far as the function tells it.
_FIRST_SIZES: Final = tuple(
    tuple((reading, size) for reading, foretell in enumerate(_READINGS) if (size := foretell(bytes((code,)))))
    for code in range(256)
)
_FORETOLD: Final = bytes(code for code in range(1, 256) if _FIRST_SIZES[code])
#: A unit identifier, and behind it a function whose frames tell their size.
_BEGIN: Final = re.compile(b"(?s).(?=[" + re.escape(_FORETOLD) + b"])")
#: The same without those of exceptions; and all of an exception.
_NO_REFUSAL: Final = re.compile(b"(?s).(?=[" + re.escape(_FORETOLD.translate(None, bytes(range(128, 256)))) + b"])")
_REFUSAL: Final = re.compile(b"(?s).(?=[\x80-\xff]...)")


class PassingFrames:
    """Finds frames of foretold size, however the bytes are cut.

    Nothing is looked at again for each new byte: each place once as a beginning, and then where the frame that may have
    begun there should end.
    """

    def __init__(self) -> None:
        self._buffer = b""
        #: How much was received, and in the order of their ends, where frames should end, where they would have begun,
        #: and how they are read.
        self._received = 0
        self._begun: list[tuple[int, int, int]] = []

    def received(self, data: bytes, now: float) -> list[Frame]:  # noqa: ARG002 - as a framer does it
        """Take bytes that became readable; the frames that are complete with them, in the order of their ends."""
        known, data = len(self._buffer), self._buffer + data
        offset = self._received - known
        self._received = offset + len(data)
        self._look_for_beginnings(data, known, offset)
        ends = self._ended(data, offset)
        self._buffer = data[1 - MAX_RTU_ADU :]
        return [_frame(data, start - offset, end - offset) for end, start in ends.items()]

    def _look_for_beginnings(self, data: bytes, known: int, offset: int) -> None:
        """Note where frames may begin. `data` is what was received from `offset` on, and so much of it is `known`.

        Half of all noise looks like the beginning of an exception. So these are noted only once they are complete.
        """
        for begin in _NO_REFUSAL.finditer(data, max(0, known - 1)):
            start = begin.start()
            for reading, size in _FIRST_SIZES[data[start + 1]]:
                heappush(self._begun, (offset + start + size + _OVERHEAD, offset + start, reading))
        for refusal in _REFUSAL.finditer(data, max(0, known + 1 - _REFUSAL_SIZE)):
            start = refusal.start()
            if crc_fits(data[start : start + _REFUSAL_SIZE]):
                heappush(self._begun, (offset + start + _REFUSAL_SIZE, offset + start, _RESPONSE))

    def _ended(self, data: bytes, offset: int) -> dict[int, int]:
        """Where frames have ended, and where they began. What has told more of its size meanwhile is noted anew."""
        ends: dict[int, int] = {}
        while self._begun and self._begun[0][0] <= self._received:
            end, start, reading = heappop(self._begun)
            at = start - offset
            size = _READINGS[reading](data[at + 1 : at + 1 + MAX_PDU])
            adu_size = size + _OVERHEAD
            if start + adu_size > end and size <= MAX_PDU:
                heappush(self._begun, (start + adu_size, start, reading))
            elif start + adu_size == end and crc_fits(data[at : at + adu_size]):
                ends[end] = start
        return ends


def frames_in(data: bytes) -> tuple[list[Frame], bytes]:
    """The frames in `data`, one behind the other, and the bytes before, between and behind them."""
    frames, rest, at = [], b"", 0
    for start, end in places(data):
        if start >= at:
            frames.append(_frame(data, start, end))
            rest += data[at:start]
            at = end
    return frames, rest + data[at:]


def places(data: bytes) -> Iterator[tuple[int, int]]:
    """Where a frame begins and ends in `data`, in the order of the beginnings."""
    for begin in _BEGIN.finditer(data):
        start = begin.start()
        pdu = data[start + 1 : start + 1 + MAX_PDU]
        for size in {request_size(pdu), response_size(pdu)}:
            end = start + size + _OVERHEAD
            if 0 < size <= len(pdu) and end <= len(data) and crc_fits(data[start:end]):
                yield start, end


def _frame(data: bytes, start: int, end: int) -> Frame:
    return Frame(data[start], data[start + 1 : end - 2])
