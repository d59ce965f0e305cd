"""Faults of a simulated device."""

from dataclasses import dataclass
from random import Random
from typing import Final

#: A late device takes its profile's time limit times _LATE, plus _LATER seconds.
_LATE: Final = 1.25
_LATER: Final = 0.15
#: The most bytes of noise before a response.
_MOST_NOISE: Final = 4


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults of a device.

    `silent`: it never responds. `slow`: additional seconds before each response. `late`: it takes longer than its
    profile allows. `noise`: the share of its responses, 0 to 1, that have a flipped bit or bytes of noise before them.
    """

    silent: bool = False
    slow: float = 0.0
    late: bool = False
    noise: float = 0.0

    def delay(self, time: float, allowed: float) -> float:
        """Return the seconds until a response: `time` without faults; its profile allows `allowed`."""
        return self.slow + (_LATE * allowed + _LATER if self.late else time)

    def on_the_line(self, adu: bytes, dice: Random) -> bytes:
        """Return the response as it arrives, perhaps damaged."""
        if dice.random() >= self.noise:
            return adu
        if dice.random() < 0.5:
            return dice.randbytes(dice.randint(1, _MOST_NOISE)) + adu
        return flip_bit(adu, dice.randrange(8 * len(adu)))


NO_FAULTS: Final = Faults()


@dataclass(frozen=True, slots=True)
class LineFaults:
    """The faults of a line. `echo`: the adapter returns what is sent. `second_client`: another client polls."""

    echo: bool = False
    second_client: bool = False


NO_LINE_FAULTS: Final = LineFaults()


def flip_bit(data: bytes, bit: int) -> bytes:
    """Flip one bit, counted from the lowest one of the first byte. CRC and LRC detect that."""
    at, place = divmod(bit, 8)
    return data[:at] + bytes((data[at] ^ 1 << place,)) + data[at + 1 :]
