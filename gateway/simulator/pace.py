"""Characters on their way along a line, one character time apart."""

from math import ceil
from random import Random
from typing import Final

from gateway.timing.characters import LineTiming

#: Characters shorter than this are handed over several at a time, in seconds.
SHORTEST_STEP: Final = 0.001


class Transmission:
    """`data`, sent by somebody from `start` on at the rate of `timing`. A character is there when its last bit is."""

    def __init__(self, data: bytes, start: float, timing: LineTiming) -> None:
        self.data = data
        self.start = start
        self.timing = timing
        self._arrived = 0
        self._step = ceil(SHORTEST_STEP / timing.character)

    @property
    def end(self) -> float:
        """When the last character is there."""
        return self._time_of(len(self.data))

    @property
    def is_over(self) -> bool:
        """Whether all of it was taken."""
        return self._arrived == len(self.data)

    def next_arrival(self) -> float:
        """When the next characters are there."""
        return self._time_of(min(self._arrived + self._step, len(self.data)))

    def take(self, now: float) -> bytes:
        """The characters that are there and were not taken before."""
        first = self._arrived
        while not self.is_over and self.next_arrival() <= now:
            self._arrived = min(self._arrived + self._step, len(self.data))
        return self.data[first : self._arrived]

    def garble(self, dice: Random) -> None:
        """Somebody else sends too: what has not arrived is rubbish."""
        self.data = self.data[: self._arrived] + dice.randbytes(len(self.data) - self._arrived)

    def _time_of(self, count: int) -> float:
        return self.start + count * self.timing.character
