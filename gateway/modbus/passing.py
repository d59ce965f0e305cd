"""The RTU frames that pass on a line, whoever sends them: for those who listen without having asked.

Nobody says whether a frame is a request or a response, and noise, halves and holes stand between them. So each place is
looked at as the beginning of either, and a frame is found when its last byte is there and its CRC fits.
"""

import re
from collections.abc import Iterator
from typing import Final

from gateway.modbus.checks import crc_fits
from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.foretell import request_size, response_size
from gateway.modbus.frame import Frame

#: The unit identifier before the PDU and the CRC behind it.
_OVERHEAD: Final = 3
_FORETOLD: Final = bytes(
    code for code in range(1, 256) if request_size(bytes((code,))) or response_size(bytes((code,)))
)
#: A unit identifier, and behind it a function whose frames tell their size.
_BEGIN: Final = re.compile(b"(?s).(?=[" + re.escape(_FORETOLD) + b"])")


class PassingFrames:
    """Finds frames of foretold size, however the bytes are cut."""

    def __init__(self) -> None:
        self._buffer = b""

    def received(self, data: bytes, now: float) -> list[Frame]:  # noqa: ARG002 - as a framer does it
        """Take bytes that became readable; the frames that are complete with them, in the order of their ends."""
        known, data = len(self._buffer), self._buffer + data
        ends = sorted({end: start for start, end in places(data) if end > known}.items())
        is_complete = bool(ends) and ends[-1][0] == len(data)
        self._buffer = b"" if is_complete else data[1 - MAX_RTU_ADU :]
        return [_frame(data, start, end) for end, start in ends]


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
