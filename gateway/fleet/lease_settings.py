"""The settings of a lease, and the times derived from them."""

from dataclasses import dataclass
from typing import Final, Literal

from gateway.timing.lease_time import HOLDS

#: Renewals per time in which the holder may write.
_RENEWALS: Final = 3


@dataclass(frozen=True, slots=True)
class LeaseSettings:
    """The settings of one lease; all times in seconds.

    `ttl` is its time to live without a renewal. `guard` is longer than any transaction on the line; an answer may still
    come for `late` seconds after that. `fallback` is what the holder does when the store cannot be reached.
    """

    name: str
    ttl: float
    guard: float
    late: float
    fallback: Literal["release", "hold"] = "release"

    @property
    def writes_for(self) -> float:
        """How long the holder may write after sending a renewal, in seconds."""
        return HOLDS * self.ttl - self.guard

    @property
    def step(self) -> float:
        """Time between renewals, and the limit of each call of the store, in seconds."""
        return self.writes_for / _RENEWALS
