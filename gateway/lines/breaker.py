"""The back-off of units that do not respond, so that they take little of their line's time.

After three failures in a row a unit rests: its requests get 0B at once. The rest counts from the end of the last late
window. The next request after it is the probe; the gateway sends none of its own. If it fails too, the next rest is
twice as long. A request is one failure, however often it is repeated, and a rest does not stop its repeats: a unit may
need a second request to wake up. A rest lasts at least nine time limits for each time the request was sent, so that an
unresponsive unit uses at most a tenth of the line, unless a shorter maximum is configured. Any valid response ends the
back-off, even a late or an unexpected one.
"""

from typing import Final

#: Failures in a row after which a unit rests.
FAILURES: Final = 3
#: The first rest and the default maximum, in seconds; by default a rest is at least this many time limits long.
FIRST_REST: Final = 1.0
LONGEST_REST: Final = 60.0
LIMITS_PER_REST: Final = 9


class Breaker:
    """Decides whether requests to one unit may be sent."""

    __slots__ = ("_until", "failures", "rest")

    def __init__(self) -> None:
        #: Failures in a row.
        self.failures = 0
        #: Length of the last rest in seconds; 0 if there was none since the last response.
        self.rest = 0.0
        self._until = 0.0

    def is_resting(self, now: float) -> bool:
        """Tell whether the unit rests at `now`."""
        return now < self._until

    def rest_left(self, now: float) -> float:
        """Return how much longer the unit rests, in seconds."""
        return max(0.0, self._until - now)

    def record_failure(
        self, limit: float, window_end: float, longest: float | None = None, *, failed_before: int = 0
    ) -> bool:
        """Count a request that failed after `limit` seconds, and `failed_before` times before.

        Return True if a rest begins. Late responses may come until `window_end`. `longest` is the maximum in seconds: 0
        for no rest, None for the default.
        """
        self.failures += not (failed_before and self.failures)
        if self.failures < FAILURES or longest == 0:
            return False
        least = LIMITS_PER_REST * limit * (1 + failed_before)
        if longest is None:
            longest = max(LONGEST_REST, least)
        rest = self.rest if failed_before else 2 * self.rest
        self.rest = min(max(FIRST_REST, least, rest), longest)
        self._until = window_end + self.rest
        return not failed_before

    def record_success(self) -> bool:
        """Start anew: the unit has responded. Return True if that ends a back-off."""
        rested = self.rest > 0.0
        self.failures, self.rest, self._until = 0, 0.0, 0.0
        return rested
