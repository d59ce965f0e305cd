"""Clients that are not read for a moment, because the queue of a line has refused a request of theirs."""

import asyncio
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Final

from gateway.clock.lazy_timer import LazyTimer

#: At most so many clients are read again at once, and then none for so many seconds. Each may cause a refusal, which
#: costs some 50 us: so all of them together take a twentieth of a processor, however many they are. One by one they
#: would cost more, because the gateway would wake up for each.
MOST_AT_ONCE: Final = 8
PAUSE: Final = 0.008


class Holds:
    """Calls back when a client may be read again: in its turn, with one timer for all."""

    def __init__(self) -> None:
        self._timer: LazyTimer | None = None
        self._held: list[tuple[float, int, Callable[[], bool]]] = []
        self._number = 0
        self._next_at = 0.0

    def add(self, seconds: float, release: Callable[[], bool]) -> None:
        """Call `release` after `seconds`, or later if many are held. It returns False if its client is gone.

        Clients that are gone take no turns: connections that come, are refused and leave would hold up all others.
        """
        self._number += 1
        heappush(self._held, (_now() + seconds, self._number, release))
        self._plan()

    def close(self) -> None:
        """Release nobody any more."""
        if self._timer is not None:
            self._timer.close()
        self._held.clear()

    def _release(self) -> None:
        now, count = _now(), 0
        while count < MOST_AT_ONCE and self._held and self._held[0][0] <= now:
            count += heappop(self._held)[2]()
        self._next_at = now + PAUSE
        self._plan()

    def _plan(self) -> None:
        if self._timer is None:
            self._timer = LazyTimer(asyncio.get_running_loop(), self._release)
        if self._held:
            self._timer.set(max(self._held[0][0], self._next_at))


def _now() -> float:
    return asyncio.get_running_loop().time()
