"""Times on a serial line: a character, a frame, and the silences between frames. All in seconds."""

import re
from dataclasses import dataclass, field
from typing import Final, Literal, Self

from gateway.modbus.codes import MAX_PDU

#: Above this rate the silences are fixed (S 2.5.1.1).
FASTEST_SCALED_BAUD: Final = 19200
T35_FIXED: Final = 0.001750

Mode = Literal["rtu", "ascii"]
Parity = Literal["N", "E", "O"]

_FORMAT = re.compile(r"([78])([NEO])([12])")


@dataclass(frozen=True, slots=True)
class CharacterFormat:
    """Data bits, parity and stop bits of a character, written `8E1`."""

    data_bits: int
    parity: Parity
    stop_bits: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a format, such as `8E1` or `7O1`.

        Raises:
            ValueError: `text` is no character format.
        """
        match = _FORMAT.fullmatch(text)
        if match is None:
            raise ValueError("a format is written like 8E1: 7 or 8 data bits, parity N, E or O, 1 or 2 stop bits")
        data_bits, parity, stop_bits = match.groups()
        return cls(int(data_bits), parity, int(stop_bits))  # type: ignore[arg-type]  # the pattern admits N, E and O only

    @property
    def bits(self) -> int:
        """Bits of one character on the line, the start bit included."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits

    def __str__(self) -> str:
        return f"{self.data_bits}{self.parity}{self.stop_bits}"


@dataclass(frozen=True, slots=True)
class LineTiming:
    """The times that follow from a line's mode, rate and character format."""

    mode: Mode
    baud: int
    format: CharacterFormat
    #: One character on the line.
    character: float = field(init=False, repr=False, compare=False)
    #: Characters of a frame for each byte of its PDU, and around them.
    _each: int = field(init=False, repr=False, compare=False)
    _around: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "character", self.format.bits / self.baud)
        # RTU: unit, PDU, CRC.  ASCII: two digits for each byte of unit, PDU and LRC, between : and CR LF.
        object.__setattr__(self, "_each", 2 if self.mode == "ascii" else 1)
        object.__setattr__(self, "_around", 7 if self.mode == "ascii" else 3)

    @property
    def t35(self) -> float:
        """The silence between two RTU frames (S 2.5.1.1)."""
        return self.silence(3.5)

    def silence(self, characters: float) -> float:
        """Compute the silence of this many characters; above 19200 baud in proportion to the fixed t3.5."""
        if self.baud > FASTEST_SCALED_BAUD:
            return T35_FIXED * characters / 3.5
        return characters * self.character

    def frame_end(self, idle_chars: float) -> float:
        """Compute the silence that ends a frame: none in ASCII, where CR LF ends it."""
        return 0.0 if self.mode == "ascii" else self.silence(idle_chars)

    def frame(self, pdu_size: int) -> float:
        """Compute the time of a frame with a PDU of this many bytes."""
        return (self._each * pdu_size + self._around) * self.character

    @property
    def longest_frame(self) -> float:
        """A frame with the longest PDU."""
        return self.frame(MAX_PDU)
