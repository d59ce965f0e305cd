"""How devices find frames in what they hear: strictly, by time, as small devices do.

The gateway's own framers forgive noise and holes. A device does not: what stands between two silences is a frame, and
when its CRC does not fit it is nothing. So a gateway that leaves too little silence gets no answer here either.
"""

from typing import Final, Protocol

from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.checks import crc_fits
from gateway.modbus.codes import MAX_RTU_ADU
from gateway.modbus.frame import Frame

#: Unit identifier, function code, CRC.
_SHORTEST: Final = 4
#: Seven bits, but no character of a frame.
_NOISE: Final = b"\x7f"


class Ear(Protocol):
    """Finds frames. What it hears may lie in the future: `take` gives a frame once it has ended."""

    def hear(self, data: bytes, start: float, character: float, silence: float) -> None:
        """These characters come one behind the other from `start` on; `silence` seconds end a frame."""

    def spoil(self) -> None:
        """Something came between: what is being heard is no frame."""

    def deadline(self) -> float | None:
        """When the next frame ends, or None."""

    def take(self, now: float) -> list[Frame]:
        """The frames that have ended."""


class RtuEar:
    """A frame is what stands between two silences (S 2.5.1.1)."""

    def __init__(self) -> None:
        self._data = b""
        self._ends_at: float | None = None
        self._spoilt = False

    def hear(self, data: bytes, start: float, character: float, silence: float) -> None:
        """These characters follow; every frame that had ended before `start` has been taken."""
        self._data = (self._data + data)[: MAX_RTU_ADU + 1]
        self._ends_at = start + len(data) * character + silence

    def spoil(self) -> None:
        """What is heard until the next silence is no frame."""
        self._spoilt = self._ends_at is not None

    def deadline(self) -> float | None:
        """When silence ends the frame."""
        return self._ends_at

    def take(self, now: float) -> list[Frame]:
        """The frame that silence has ended, if its CRC fits."""
        if self._ends_at is None or now < self._ends_at:
            return []
        adu, spoilt = self._data, self._spoilt
        self._data, self._ends_at, self._spoilt = b"", None, False
        if spoilt or not _SHORTEST <= len(adu) <= MAX_RTU_ADU or not crc_fits(adu):
            return []
        return [Frame(adu[0], adu[1:-2])]


class AsciiEar:
    """A frame is what stands between a colon and CR LF (S 2.5.2.1)."""

    def __init__(self) -> None:
        self._framer = AsciiFramer()
        self._frames: list[tuple[float, Frame]] = []

    def hear(self, data: bytes, start: float, character: float, silence: float) -> None:  # noqa: ARG002 - see RtuEar
        """These characters follow. Silence ends no frame, unless it is longer than a second."""
        for count, byte in enumerate(data, 1):
            ends_at = start + count * character
            self._frames += [(ends_at, frame) for frame in self._framer.received(bytes((byte,)), ends_at)]

    def spoil(self) -> None:
        """What is heard until the next colon is no frame."""
        self._frames.clear()
        self._framer.received(_NOISE, 0.0)

    def deadline(self) -> float | None:
        """When the last character of the next frame has come."""
        return self._frames[0][0] if self._frames else None

    def take(self, now: float) -> list[Frame]:
        """The frames whose last character has come."""
        ended = [frame for ends_at, frame in self._frames if ends_at <= now]
        self._frames = self._frames[len(ended) :]
        return ended
