"""What can be wrong with a device."""

from dataclasses import dataclass
from random import Random
from typing import Final

#: How many bytes of noise may come before an answer.
_MOST_NOISE: Final = 4


@dataclass(frozen=True, slots=True)
class Faults:
    """What is wrong with a device.

    `silent`: it is as good as switched off. `slow`: seconds that it takes longer. `noise`: the share of its answers,
    0 to 1, that have a flipped bit or bytes of noise before them.
    """

    silent: bool = False
    slow: float = 0.0
    noise: float = 0.0

    def on_the_line(self, adu: bytes, dice: Random) -> bytes:
        """What arrives of an answer."""
        if dice.random() >= self.noise:
            return adu
        if dice.random() < 0.5:
            return dice.randbytes(dice.randint(1, _MOST_NOISE)) + adu
        return flip_bit(adu, dice.randrange(8 * len(adu)))


NO_FAULTS: Final = Faults()


def flip_bit(data: bytes, bit: int) -> bytes:
    """`data` with one bit wrong, counted from the lowest one of the first byte. CRC and LRC notice each such error."""
    at, place = divmod(bit, 8)
    return data[:at] + bytes((data[at] ^ 1 << place,)) + data[at + 1 :]
