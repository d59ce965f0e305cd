"""When a part wants to be woken: one lazy timer a line instead of one a request."""

import asyncio
from collections.abc import Callable
from math import inf


class Alarm:
    """Calls back once a deadline has passed, never before it. Deadlines are `loop.time()`, in seconds.

    A line moves its deadline several times in a transaction, and mostly away from now. So a later deadline leaves the
    armed timer standing (it looks again when it fires), and only an earlier one costs a call into the loop.
    """

    __slots__ = ("_armed_for", "_callback", "_deadline", "_loop", "_timer")

    def __init__(self, loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
        self._loop = loop
        self._callback = callback
        self._deadline: float | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._armed_for = inf

    def set(self, deadline: float | None) -> None:
        """Call back at `deadline` instead of any deadline set before; None: not at all."""
        self._deadline = deadline
        if deadline is not None and deadline < self._armed_for:
            self._arm(deadline)

    def close(self) -> None:
        """Never call back again."""
        self._deadline = None
        self._armed_for = -inf
        self._disarm()

    def _arm(self, when: float) -> None:
        self._disarm()
        self._armed_for = when
        self._timer = self._loop.call_at(when, self._fired)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _fired(self) -> None:
        self._timer = None
        self._armed_for = inf
        deadline = self._deadline
        if deadline is None:
            return
        if self._loop.time() < deadline:
            self._arm(deadline)
            return
        self._deadline = None
        self._callback()

    def __repr__(self) -> str:
        if self._deadline is None:
            return "<Alarm off>"
        return f"<Alarm in {1000 * (self._deadline - self._loop.time()):.1f} ms>"
