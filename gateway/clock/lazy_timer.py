"""One timer for each line instead of one for each request."""

import asyncio
from collections.abc import Callable
from functools import partial
from math import inf

from gateway.clock.exact_loop import ExactLoop


class LazyTimer:
    """Calls back once a deadline has passed, never before. Deadlines are `loop.time()`, in seconds.

    A line changes its deadline several times in a transaction, to a later one and back. So the loop is asked for a call
    only if no pending one is as early, and calls are not cancelled: one before the deadline only checks the time.
    """

    __slots__ = ("_call_at", "_callback", "_calls", "_deadline", "_time")

    def __init__(self, loop: asyncio.AbstractEventLoop, callback: Callable[[], None], *, first: bool = False) -> None:
        """One that is `first` comes before what is ready: see `Waiter.wake_at`."""
        self._call_at: Callable[[float, Callable[[], None]], object] = loop.call_at
        if isinstance(loop, ExactLoop):
            self._call_at = partial(loop.wake_at, first=True) if first else loop.wake_at
        self._time = loop.time
        self._callback: Callable[[], None] | None = callback
        self._deadline = inf
        #: The times of pending calls, the next one last.
        self._calls: list[float] = []

    def set(self, deadline: float | None) -> None:
        """Replace the deadline; None for no callback."""
        self._deadline = inf if deadline is None else deadline
        if self._deadline != inf:
            self._ask()

    def close(self) -> None:
        """Never call back again."""
        self._deadline = inf
        self._callback = None

    def _ask(self) -> None:
        """Have the loop call at the deadline, unless it calls earlier."""
        if self._callback is not None and not (self._calls and self._calls[-1] <= self._deadline):
            self._calls.append(self._deadline)
            self._call_at(self._deadline, self._called)

    def _called(self) -> None:
        self._calls.pop()
        if self._deadline == inf:
            return
        if self._time() < self._deadline:
            self._ask()
        elif self._callback is not None:
            self._deadline = inf
            self._callback()

    def __repr__(self) -> str:
        if self._deadline == inf:
            return "<LazyTimer off>"
        return f"<LazyTimer in {1000 * (self._deadline - self._time()):.1f} ms>"
