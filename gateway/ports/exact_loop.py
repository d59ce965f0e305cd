"""An event loop whose timers are exact to microseconds instead of a millisecond.

asyncio waits in `epoll_wait`, which counts in milliseconds. Above 19200 baud, t3.5 is 1.75 ms, so that a millisecond is
a tenth of what a fast line can carry. `select` counts in microseconds, and can wait for the descriptor of an epoll. Why
not a timer descriptor for each line: docs/adr/0009-exact-timers.md
"""

import asyncio
import select
import selectors
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

T = TypeVar("T")

#: `select` is used for the last part of a wait, in seconds. Silences and frames are shorter, most time limits longer.
EXACT_PART: Final = 0.06
#: `select` supports only descriptors below this number (select(2)).
_SELECTABLE: Final = 1024
#: The kernel may let a thread sleep so many nanoseconds longer, by default 50 000 (proc(5)).
_SLACK: Final = Path("/proc/self/timerslack_ns")


def run_exactly(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` as asyncio.run does, in an exact loop."""
    with asyncio.Runner(loop_factory=exact_loop) as runner:
        return runner.run(main)


def exact_loop() -> asyncio.AbstractEventLoop:
    """A new event loop with exact timers, for the main thread."""
    with suppress(OSError):  # timers are 50 us later then
        _SLACK.write_text("1")
    return asyncio.SelectorEventLoop(ExactSelector())


class ExactSelector(selectors.EpollSelector):
    """Waits exactly. A longer wait may end early by EXACT_PART: asyncio then waits again."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for descriptors; see selectors.BaseSelector."""
        if timeout is None or timeout <= 0 or not self._is_selectable:
            return super().select(timeout)
        if timeout > EXACT_PART:
            return super().select(timeout - EXACT_PART)
        ready, _, _ = select.select((self.fileno(),), (), (), timeout)
        return super().select(0) if ready else []

    @property
    def _is_selectable(self) -> bool:
        return self.fileno() < _SELECTABLE
