"""What a TCP listener does at regular times: it sweeps its connections, and looks for unread bytes."""

import asyncio
from collections.abc import Callable

from gateway.clock.lazy_timer import LazyTimer
from gateway.listeners.arrivals import LOOK_STEP


class Rounds:
    """Calls `sweep` every `step` seconds; and `look` every LOOK_STEP once asked, as long as it returns True."""

    def __init__(self, step: float, sweep: Callable[[], None], look: Callable[[], bool]) -> None:
        loop = asyncio.get_running_loop()
        self._now = loop.time
        self._step = step
        self._sweep = sweep
        self._look = look
        self._sweeping = LazyTimer(loop, self._swept)
        self._looking = LazyTimer(loop, self._looked)
        self._is_looking = False
        self._sweeping.set(self._now() + step)

    def look_later(self) -> None:
        """Begin to look, unless that goes on already: clients that connect must not put it off."""
        if not self._is_looking:
            self._is_looking = True
            self._looking.set(self._now() + LOOK_STEP)

    def close(self) -> None:
        """Call nothing any more."""
        self._sweeping.close()
        self._looking.close()

    def _swept(self) -> None:
        self._sweep()
        self._sweeping.set(self._now() + self._step)

    def _looked(self) -> None:
        self._is_looking = False
        if self._look():
            self.look_later()
