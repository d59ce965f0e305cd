"""Measures how fast the file of kept values fills, and how long it takes to send them."""

from collections.abc import Callable
from typing import Final

from gateway.events import Emit, KeptValuesSent

#: The file is looked at for so many seconds before it is told when it will be full.
_LOOKS_FOR: Final = 60.0


class Progress:
    """What was sent since `begin`, and how the file has grown since. `now` returns the time in seconds of any clock."""

    def __init__(self, emit: Emit, now: Callable[[], float]) -> None:
        self._emit = emit
        self._now = now
        self._sent = 0
        self._begun_at: float | None = None
        self._is_told = False
        #: A time and the size of the file then; None while values are sent.
        self._grows_from: tuple[float, int] | None = None

    def begin(self) -> None:
        """Count what is sent from now on: the connection is lost."""
        self._sent, self._begun_at, self._is_told = 0, None, False

    def sent(self, values: int) -> None:
        """Count values that the broker has."""
        if self._begun_at is None:
            self._begun_at = self._now()
        self._sent += values
        self._grows_from = None

    def left(self, values: int) -> None:
        """Tell that all is sent, once for each `begin`, if so many values are left; not if the broker took none."""
        if not values:
            self._grows_from = None
        if not values and self._sent and self._begun_at is not None and not self._is_told:
            self._is_told = True
            self._emit(KeptValuesSent(self._sent, round(self._now() - self._begun_at, 1)))

    def written(self, size: int) -> None:
        """Note how large the file is."""
        if self._grows_from is None or size < self._grows_from[1]:
            self._grows_from = self._now(), size

    def full_in(self, size: int, room: int) -> float | None:
        """Return in how many seconds a file of this size fills its room at the rate so far; None if unknown."""
        if self._grows_from is None:
            return None
        since, at_first = self._grows_from
        seconds, grown = self._now() - since, size - at_first
        return None if grown <= 0 or seconds < _LOOKS_FOR else max(0.0, room - size) * seconds / grown
