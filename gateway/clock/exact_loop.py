"""The event loop of the gateway, with timers exact to microseconds, and one plain call for a ready descriptor.

It is asyncio's loop on a selector that calls the callbacks of ready descriptors itself (`clock/waiter.py`), and returns
only when the loop has something else to do. Measurements: docs/performance.md
"""

import asyncio
import selectors
import sys
from collections.abc import Callable, Coroutine
from contextlib import suppress
from contextvars import Context
from pathlib import Path
from time import monotonic
from typing import Any, Final, TypeVar

from gateway.clock.system_calls import wait_of
from gateway.clock.waiter import Waiter

T = TypeVar("T")

#: The private names of Python's library that are used here.
_NAMES: Final = (
    (selectors.EpollSelector, "_selector_cls"),  # makes its `_selector`
    *((asyncio.Handle, name) for name in ("_context", "_callback", "_args")),
)
#: The kernel may let a thread sleep this many nanoseconds longer, by default 50 000 (proc(5)).
_SLACK: Final = Path("/proc/self/timerslack_ns")
#: How long a computing thread, such as one that makes a page, may keep the loop waiting, in seconds; by default 5 ms.
_HAND_OVER: Final = 0.0005


def run_exactly(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` as asyncio.run does, in an exact loop."""
    with asyncio.Runner(loop_factory=new_exact_loop) as runner:
        return runner.run(main)


def new_exact_loop() -> asyncio.AbstractEventLoop:
    """Make an event loop with exact timers, for the main thread."""
    with suppress(OSError):  # timers are 50 us late then
        _SLACK.write_text("1")
    sys.setswitchinterval(_HAND_OVER)
    if all(hasattr(owner, name) for owner, name in _NAMES):
        selector = ExactSelector()
        with suppress(AttributeError):
            return ExactLoop(selector)
        selector.close()
    return asyncio.SelectorEventLoop()  # a future Python without these names: timers are 1 ms late


class ExactSelector(selectors.EpollSelector):
    """A selector that waits with a Waiter. Its loop registers pairs of handles: one to read, one to write."""

    def __init__(self) -> None:
        super().__init__()
        epoll = self._selector  # type: ignore[attr-defined]  # private, so not in the stubs
        self.waiter = Waiter(epoll, wait_of(epoll))
        self.select = self.waiter.wait  # type: ignore[assignment,method-assign]  # for its loop

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Register the handles in `data`, with the waiter too."""
        key = super().register(fileobj, events, data)
        self.waiter.register(key.fd, data)
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Unregister a descriptor, from the waiter too."""
        key = super().unregister(fileobj)
        self.waiter.unregister(key.fd)
        return key

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Replace the handles by those in `data`, in the waiter too."""
        key = super().modify(fileobj, events, data)
        self.waiter.register(key.fd, data)
        return key


class ExactLoop(asyncio.SelectorEventLoop):
    """An event loop on an ExactSelector. `mask`, `unmask` and `wake_at`: see Waiter."""

    time = staticmethod(monotonic)

    def __init__(self, selector: ExactSelector) -> None:
        super().__init__(selector)
        self._waiter = selector.waiter
        self._waiter.ready = self._ready  # type: ignore[attr-defined]  # private, so not in the stubs
        self._waiter.call_soon = self.call_soon
        self._waiter.failed = self._callback_failed
        self.mask = self._waiter.mask
        self.unmask = self._waiter.unmask
        self.wake_at = self._waiter.wake_at

    def call_at(
        self, when: float, callback: Callable[..., object], *args: object, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call `callback` at `when`, as asyncio does; a wait in progress ends in time for it."""
        self._waiter.end_by(when)
        return super().call_at(when, callback, *args, context=context)

    def stop(self) -> None:
        """Stop the loop, as asyncio does; a wait in progress ends."""
        self._waiter.end_by(0.0)
        super().stop()

    def _callback_failed(self, error: BaseException) -> None:
        self.call_exception_handler({"message": "a callback has failed", "exception": error})
