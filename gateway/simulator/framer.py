"""Finds frames the way small devices do: strictly by time.

The gateway's own framers tolerate noise and gaps. A device does not: the bytes between two silences are one frame, or
nothing if the CRC is wrong. So too little silence before a request means no response, as with a real device.
"""

from typing import Final, Protocol

from gateway.modbus import ascii as ascii_framing
from gateway.modbus.codes import MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import crc_fits

#: Unit identifier, function code, CRC.
_SHORTEST: Final = 4
#: A seven-bit character that is never part of a frame.
_NOISE: Final = b"\x7f"


class Framer(Protocol):
    """Finds frames. Bytes may be handed over before they arrive: `take` returns a frame once it has ended."""

    def receive(self, data: bytes, start: float, character: float, silence: float) -> None:
        """Take characters that arrive every `character` seconds from `start` on; `silence` seconds end a frame."""

    def spoil(self) -> None:
        """Drop the bytes up to the end of this frame: something interfered."""

    def deadline(self) -> float | None:
        """Return when the next frame ends, or None."""

    def take(self, now: float) -> list[Frame]:
        """Return the frames that have ended by `now`."""


class RtuFramer:
    """A framer by silences: a frame is the bytes between two of them (S 2.5.1.1)."""

    def __init__(self) -> None:
        self._data = b""
        self._ends_at: float | None = None
        self._spoilt = False

    def receive(self, data: bytes, start: float, character: float, silence: float) -> None:
        """Add characters; every frame that ended before `start` must have been taken."""
        self._data = (self._data + data)[: MAX_RTU_ADU + 1]
        self._ends_at = start + len(data) * character + silence

    def spoil(self) -> None:
        """Drop everything up to the next silence."""
        self._spoilt = self._ends_at is not None

    def deadline(self) -> float | None:
        """Return when silence ends the frame; None if there is none."""
        return self._ends_at

    def take(self, now: float) -> list[Frame]:
        """Return the frame that silence has ended, if its CRC fits."""
        if self._ends_at is None or now < self._ends_at:
            return []
        adu, spoilt = self._data, self._spoilt
        self._data, self._ends_at, self._spoilt = b"", None, False
        if spoilt or not _SHORTEST <= len(adu) <= MAX_RTU_ADU or not crc_fits(adu):
            return []
        return [Frame(adu[0], adu[1:-2])]


class AsciiFramer:
    """A framer by delimiters: a frame is the characters from a colon to CR LF (S 2.5.2.1)."""

    def __init__(self) -> None:
        self._framer = ascii_framing.AsciiFramer()
        self._frames: list[tuple[float, Frame]] = []

    def receive(self, data: bytes, start: float, character: float, silence: float) -> None:  # noqa: ARG002 - see RtuFramer
        """Add characters. Only a silence of more than a second ends a frame early."""
        for count, byte in enumerate(data, 1):
            ends_at = start + count * character
            self._frames += [(ends_at, frame) for frame in self._framer.received(bytes((byte,)), ends_at)]

    def spoil(self) -> None:
        """Drop everything up to the next colon."""
        self._frames.clear()
        self._framer.received(_NOISE, 0.0)

    def deadline(self) -> float | None:
        """Return when the last character of the next frame arrives; None if there is none."""
        return self._frames[0][0] if self._frames else None

    def take(self, now: float) -> list[Frame]:
        """Return the frames whose last character has arrived."""
        ended = [frame for ends_at, frame in self._frames if ends_at <= now]
        self._frames = self._frames[len(ended) :]
        return ended
