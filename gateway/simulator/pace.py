"""Characters in transmission on a line, one character time apart."""

from math import ceil
from random import Random
from typing import Final

from gateway.timing.characters import LineTiming

#: If characters are shorter than this, several are delivered at a time; in seconds.
SHORTEST_STEP: Final = 0.001


class Transmission:
    """`data`, sent from `start` on at the rate of `timing`. A character arrives with its last bit."""

    def __init__(self, data: bytes, start: float, timing: LineTiming) -> None:
        self.data = data
        self.start = start
        self.timing = timing
        self._arrived = 0
        self._step = ceil(SHORTEST_STEP / timing.character)

    @property
    def end(self) -> float:
        """When the last character arrives."""
        return self._time_of(len(self.data))

    @property
    def is_over(self) -> bool:
        """Whether all characters were taken."""
        return self._arrived == len(self.data)

    def next_arrival(self) -> float:
        """Return when the next characters arrive."""
        return self._time_of(min(self._arrived + self._step, len(self.data)))

    def take(self, now: float) -> bytes:
        """Return the characters that have arrived since the last call."""
        first = self._arrived
        while not self.is_over and self.next_arrival() <= now:
            self._arrived = min(self._arrived + self._step, len(self.data))
        return self.data[first : self._arrived]

    def garble(self, dice: Random) -> None:
        """Replace what has not arrived by random bytes, as in a collision."""
        self.data = self.data[: self._arrived] + dice.randbytes(len(self.data) - self._arrived)

    def _time_of(self, count: int) -> float:
        return self.start + count * self.timing.character
