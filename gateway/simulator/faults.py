"""Faults of a simulated device."""

from dataclasses import dataclass
from random import Random
from typing import Final

#: The most bytes of noise before a response.
_MOST_NOISE: Final = 4


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults of a device.

    `silent`: it never responds. `slow`: additional seconds before each response. `noise`: the share of its responses, 0
    to 1, that have a flipped bit or bytes of noise before them.
    """

    silent: bool = False
    slow: float = 0.0
    noise: float = 0.0

    def on_the_line(self, adu: bytes, dice: Random) -> bytes:
        """The response as it arrives."""
        if dice.random() >= self.noise:
            return adu
        if dice.random() < 0.5:
            return dice.randbytes(dice.randint(1, _MOST_NOISE)) + adu
        return flip_bit(adu, dice.randrange(8 * len(adu)))


NO_FAULTS: Final = Faults()


def flip_bit(data: bytes, bit: int) -> bytes:
    """`data` with one bit flipped, counted from the lowest one of the first byte. CRC and LRC detect that."""
    at, place = divmod(bit, 8)
    return data[:at] + bytes((data[at] ^ 1 << place,)) + data[at + 1 :]
