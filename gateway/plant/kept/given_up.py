"""Counts values that are given up, and tells of them: at once, then once a minute."""

from collections import Counter
from collections.abc import Callable
from typing import Final

from gateway.events import Emit, ValuesGivenUp
from gateway.timing.measured import NEVER

#: How often it is told, in seconds.
_TELL_EVERY: Final = 60.0


class GivenUp:
    """Values that will never be sent. `now` returns the time in seconds of any clock."""

    def __init__(self, emit: Emit, now: Callable[[], float]) -> None:
        self.values = 0
        self._emit = emit
        self._now = now
        self._at = self._told_at = NEVER
        self._untold: Counter[str] = Counter()

    @property
    def age(self) -> float | None:
        """How long ago the last ones were given up, in seconds; None if there are none."""
        return self._now() - self._at if self.values else None

    def add(self, values: int, reason: str) -> None:
        """Count values that are given up for this reason; tell of them unless it was told in the last minute."""
        if not values:
            return
        self.values += values
        self._at = self._now()
        self._untold[reason] += values
        self.tell()

    def tell(self, *, is_last: bool = False) -> None:
        """Tell what was not told yet, at most once a minute unless this `is_last`."""
        if self._untold and (is_last or self._now() - self._told_at >= _TELL_EVERY):
            self._told_at = self._now()
            for reason, values in self._untold.items():
                self._emit(ValuesGivenUp(values, reason))
            self._untold.clear()
