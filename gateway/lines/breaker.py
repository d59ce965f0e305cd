"""Resting units: a device that does not answer must not take its line's time from the others.

After three failures in a row a unit rests: its requests are answered 0B at once. A rest counts from the end of the
last failure's late window. When it is over, the next client's request is the probe: the gateway sends nothing of its
own. If the probe fails too, the next rest is twice as long. A rest is at least nine limits, so a dead unit takes at
most a tenth of its line's time, unless somebody has set a longest rest that is shorter. Any valid answer of the unit,
a late one and one that nobody awaits any more included, ends all of it.
"""

from typing import Final

#: Failures in a row after which a unit rests.
FAILURES: Final = 3
#: The first rest and by default the longest one, in seconds; both at least so many time limits.
FIRST_REST: Final = 1.0
LONGEST_REST: Final = 60.0
LIMITS_PER_REST: Final = 9


class Breaker:
    """Whether one unit may be asked."""

    __slots__ = ("_until", "failures", "rest")

    def __init__(self) -> None:
        #: Failures in a row.
        self.failures = 0
        #: Length of the last rest in seconds, 0 when the unit has not rested since it was heard.
        self.rest = 0.0
        self._until = 0.0

    def is_resting(self, now: float) -> bool:
        """Whether the unit rests at `now`."""
        return now < self._until

    def rest_left(self, now: float) -> float:
        """How much longer the unit rests, in seconds."""
        return self._until - now if self.is_resting(now) else 0.0

    def record_failure(self, limit: float, window_end: float, longest: float | None = None) -> bool:
        """A request to the unit has failed after `limit` seconds; True when a rest begins with that.

        No rest is longer than `longest` seconds, 0 for none at all; None leaves it at what is usual.
        """
        self.failures += 1
        if self.failures < FAILURES or longest == 0:
            return False
        least = LIMITS_PER_REST * limit
        if longest is None:
            longest = max(LONGEST_REST, least)
        self.rest = min(max(FIRST_REST, least, 2 * self.rest), longest)
        self._until = window_end + self.rest
        return True

    def record_success(self) -> bool:
        """A valid frame has come from the unit; True when that ends its rests."""
        rested = self.rest > 0.0
        self.failures, self.rest, self._until = 0, 0.0, 0.0
        return rested
