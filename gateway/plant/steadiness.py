"""Tracks whether connections to a broker hold, and how long to wait before the next one.

Times are seconds of any clock.
"""

import random
from typing import Final

from gateway.plant.reasons import SAME_NAME, UNTOLD
from gateway.timing.measured import NEVER

#: The first pause before the gateway connects again, and the longest; each is twice the one before. In seconds.
FIRST_PAUSE: Final = 1.0
LONGEST_PAUSE: Final = 30.0
#: The pauses grow until a connection has held for this long, in seconds: two gateways with the same name end each
#: other's connections.
HOLDS: Final = 2 * LONGEST_PAUSE


class Steadiness:
    """The connections up to now: how they ended, and the pause before the next one."""

    def __init__(self) -> None:
        self._pause = FIRST_PAUSE
        self._up_at = NEVER
        self._lost_soon = 0
        self._because = ""

    def connected(self, now: float) -> None:
        """Note that a connection was made."""
        self._up_at = now

    def lost(self, reason: str, now: float) -> str:
        """Note a loss; return the reason, with a likely cause if the broker gives none and losses repeat."""
        if self._has_held(now):
            self.begin_anew()
        else:
            self._lost_soon += 1
        self._because = f"{UNTOLD}; perhaps {SAME_NAME}" if reason == UNTOLD and self._lost_soon > 1 else reason
        return self._because

    def begin_anew(self) -> None:
        """Forget earlier losses."""
        self._pause = FIRST_PAUSE
        self._lost_soon = 0

    def next_pause(self) -> float:
        """Return how many seconds to wait before the next attempt."""
        pause, self._pause = self._pause, min(2 * self._pause, LONGEST_PAUSE)
        return pause * random.uniform(0.8, 1.2)  # noqa: S311 - no secret

    def trouble(self, now: float) -> str:
        """Explain why connections were lost again and again; empty once one has held."""
        if self._lost_soon < 2 or self._has_held(now):
            return ""
        return f"lost {self._lost_soon} times in a row, each time soon after it was connected: {self._because}"

    def _has_held(self, now: float) -> bool:
        return now - self._up_at >= HOLDS
