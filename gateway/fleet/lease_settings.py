"""The settings of a lease, and what follows from them."""

from dataclasses import dataclass
from typing import Final, Literal

from gateway.timing.lease_time import HOLDS

#: The holder renews this many times in the time in which it may write.
_RENEWALS: Final = 3


@dataclass(frozen=True, slots=True)
class LeaseSettings:
    """The settings of one lease; all times in seconds.

    `ttl` is how long it lasts without a renewal. `guard` is longer than any transaction on the line, `late` is how long
    after that an answer may still come. `fallback` is what the holder does when the store cannot be reached.
    """

    name: str
    ttl: float
    guard: float
    late: float
    fallback: Literal["release", "hold"] = "release"

    @property
    def writes_for(self) -> float:
        """How long the holder may write after it has sent a renewal."""
        return HOLDS * self.ttl - self.guard

    @property
    def step(self) -> float:
        """How often the holder renews, and how long any answer of the store is waited for."""
        return self.writes_for / _RENEWALS
