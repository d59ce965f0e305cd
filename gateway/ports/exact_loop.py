"""The event loop of the gateway: its timers are exact to microseconds, and a ready descriptor is a call, no more.

asyncio waits in `epoll_wait`, which counts in milliseconds. Above 19200 baud, t3.5 is 1.75 ms, so that a millisecond is
a tenth of what a fast line can carry. `select` counts in microseconds, and can wait for the descriptor of an epoll. Why
not a timer descriptor for each line: docs/adr/0009-exact-timers.md

asyncio makes an object of each descriptor that is ready, looks it up, and lets its callback wait in a queue. Here the
selector returns the callbacks themselves, and they are called in turn. What that gains: docs/performance.md
"""

import asyncio
import select
import selectors
import sys
from collections.abc import Coroutine
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, Final, TypeVar

T = TypeVar("T")

#: `select` is used for the last part of a wait, in seconds. Silences and frames are shorter, most time limits longer.
EXACT_PART: Final = 0.06
#: `select` supports only descriptors below this number (select(2)).
_SELECTABLE: Final = 1024
#: So many descriptors are looked at between two looks at the timers.
_AT_ONCE: Final = 64
_NOBODY: Final = (None, None)
#: The private names of Python's library that are used here.
_NAMES: Final = (
    (selectors.EpollSelector, "_selector_cls"),  # which makes its `_selector`
    (asyncio.SelectorEventLoop, "_process_events"),
    (asyncio.Handle, "_run"),
    (asyncio.Handle, "_cancelled"),
)
#: The kernel may let a thread sleep so many nanoseconds longer, by default 50 000 (proc(5)).
_SLACK: Final = Path("/proc/self/timerslack_ns")
#: How long a thread that computes (one that makes a page) may keep the loop waiting, in seconds; by default 5 ms.
_HAND_OVER: Final = 0.0005


def run_exactly(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` as asyncio.run does, in an exact loop."""
    with asyncio.Runner(loop_factory=exact_loop) as runner:
        return runner.run(main)


def exact_loop() -> asyncio.AbstractEventLoop:
    """A new event loop with exact timers, for the main thread."""
    with suppress(OSError):  # timers are 50 us later then
        _SLACK.write_text("1")
    sys.setswitchinterval(_HAND_OVER)
    if not all(hasattr(owner, name) for owner, name in _NAMES):  # a Python to come: timers are 1 ms late then
        return asyncio.SelectorEventLoop()
    return ExactLoop(ExactSelector())


class ExactSelector(selectors.EpollSelector):
    """Waits exactly, for the loop below. A longer wait may end early by EXACT_PART: asyncio then waits again.

    What is registered with a descriptor is a pair of callbacks, to read and to write, each of which may be None.
    """

    def __init__(self) -> None:
        super().__init__()
        self._callbacks: dict[int, tuple[asyncio.Handle | None, asyncio.Handle | None]] = {}
        self._epoll: select.epoll = self._selector  # type: ignore[attr-defined]  # private, so not in the stubs
        self._descriptor = self.fileno()
        self._is_selectable = self._descriptor < _SELECTABLE

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See selectors.BaseSelector."""
        key = super().register(fileobj, events, data)
        self._callbacks[key.fd] = data
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """See selectors.BaseSelector."""
        key = super().unregister(fileobj)
        self._callbacks.pop(key.fd, None)
        return key

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """See selectors.BaseSelector."""
        key = super().modify(fileobj, events, data)
        self._callbacks[key.fd] = data
        return key

    def mask(self, descriptor: int, *, is_masked: bool) -> None:
        """Do not look at a registered descriptor for a while, unless what is behind it is lost; or look again.

        To remove it and register it anew takes five times as long.
        """
        self._epoll.modify(descriptor, 0 if is_masked else select.EPOLLIN)

    def select(self, timeout: float | None = None) -> list[asyncio.Handle]:  # type: ignore[override]  # for its loop
        """Wait for descriptors: the callbacks of those that are ready."""
        if timeout is None:
            wait = -1.0
        elif timeout <= 0.0:
            wait = 0.0
        elif not self._is_selectable:
            wait = timeout
        elif timeout > EXACT_PART:
            wait = timeout - EXACT_PART
        elif select.select((self._descriptor,), (), (), timeout)[0]:
            wait = 0.0
        else:
            return []
        ready = []
        for descriptor, events in self._epoll.poll(wait, _AT_ONCE):
            reader, writer = self._callbacks.get(descriptor, _NOBODY)
            if reader is not None and events & ~select.EPOLLOUT:  # the end of a connection is for both
                ready.append(reader)
            if writer is not None and events & ~select.EPOLLIN:
                ready.append(writer)
        return ready


class ExactLoop(asyncio.SelectorEventLoop):
    """An event loop on an ExactSelector."""

    time = staticmethod(monotonic)

    def __init__(self, selector: ExactSelector) -> None:
        super().__init__(selector)
        #: Leave a descriptor that is only read alone for a while: see ExactSelector.
        self.mask = selector.mask

    def _process_events(self, event_list: list[asyncio.Handle]) -> None:
        """Call what waits for these descriptors, unless another one of them has just cancelled it."""
        for handle in event_list:
            if not handle._cancelled:  # noqa: SLF001 - `cancelled()` is a call more for each
                handle._run()  # noqa: SLF001 - as the loop does
