"""An event loop in virtual time: nothing sleeps, the clock jumps to the next timer.

A test of an hour of back-off takes milliseconds and comes out the same each time: `loop.time()` starts at 0
and is exactly the time of the timer that runs. Executor jobs run inline. Descriptors are refused, since the
world behind them keeps its own time: tests of sockets, terminals and processes belong in tests/system. A test
that nothing can wake any more fails at once.
"""

import asyncio
import selectors
from collections.abc import Callable, Mapping
from typing import Any


class WaitsForEver(Exception):  # noqa: N818 - says what the test does
    """Every task waits and there is no timer: no virtual time will ever end this test."""


class DescriptorRefused(Exception):  # noqa: N818 - says what the loop did
    """A test in virtual time wants to wait for a socket, terminal or pipe."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """The event loop of all tests outside tests/system and tests/bench."""

    def __init__(self) -> None:
        self._clock = _JumpingSelector(self._next_timer)
        super().__init__(self._clock)
        self._clock.accepts_descriptors = False  # the loop's own wake-up pipe is in

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._clock.now

    def stand_still(self, seconds: float) -> None:
        """Time passes, and nothing runs: what is due then comes too late."""
        self._clock.now += seconds

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:
        """Run the job here and now; it takes no virtual time."""
        future = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - whatever the job raises belongs to who awaits it
            future.set_exception(error)
        return future

    def _next_timer(self) -> float:
        if not self._scheduled:
            tasks = "\n".join(f"  {task!r}" for task in asyncio.all_tasks(self)) or "  (there are no tasks)"
            raise WaitsForEver(f"at {self.time()} s all wait and no timer is set:\n{tasks}")
        return self._scheduled[0].when()


class _JumpingSelector(selectors.BaseSelector):
    """Moves the clock instead of waiting for descriptors."""

    def __init__(self, next_timer: Callable[[], float]) -> None:
        self.now = 0.0
        self.accepts_descriptors = True
        self._next_timer = next_timer
        self._keys: dict[Any, selectors.SelectorKey] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        if not self.accepts_descriptors:
            raise DescriptorRefused(f"no {fileobj!r} in virtual time; such a test belongs in tests/system")
        self._keys[fileobj] = selectors.SelectorKey(fileobj, fileobj, events, data)
        return self._keys[fileobj]

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._keys.pop(fileobj)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None or timeout > 0:  # 0: callbacks are ready; None: no timer is set
            self.now = max(self.now, self._next_timer())
        return []

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._keys
