"""One timer for each line instead of one for each request."""

import asyncio
from collections.abc import Callable
from math import inf


class LazyTimer:
    """Calls back once a deadline has passed, never before. Deadlines are `loop.time()`, in seconds.

    A line changes its deadline several times in a transaction, mostly to a later one. A later deadline leaves the
    loop's timer as it is: when it fires, it is set again. Only an earlier deadline costs a call into the loop.
    """

    __slots__ = ("_armed_for", "_call_at", "_callback", "_deadline", "_time", "_timer")

    def __init__(self, loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
        self._call_at = loop.call_at
        self._time = loop.time
        self._callback = callback
        self._deadline: float | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._armed_for = inf

    def set(self, deadline: float | None) -> None:
        """Replace the deadline; None for no callback."""
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
        self._timer = self._call_at(when, self._fired)

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
        if self._time() < deadline:
            self._arm(deadline)
            return
        self._deadline = None
        self._callback()

    def __repr__(self) -> str:
        if self._deadline is None:
            return "<LazyTimer off>"
        return f"<LazyTimer in {1000 * (self._deadline - self._time()):.1f} ms>"
