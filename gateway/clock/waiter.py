"""The waiting of the event loop, with calls for ready descriptors and due times. Compiled (ADR 12).

asyncio waits in `epoll_wait`, which counts in milliseconds. Above 19200 baud, t3.5 is 1.75 ms, so a millisecond is a
tenth of what a fast line can carry. `select` counts in microseconds, and can wait for the descriptor of an epoll. Why
not a timer descriptor for each line: docs/adr/0009-exact-timers.md
"""

import asyncio
import select
from collections import deque
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from math import inf
from time import monotonic
from typing import Final

#: `select` is used for the last part of a wait, in seconds. Silences and frames are shorter, most time limits longer.
EXACT_PART: Final = 0.06
#: `select` supports only descriptors below this number (select(2)).
SELECTABLE: Final = 1024
#: This many descriptors are looked at between two looks at the timers.
_BATCH: Final = 64
#: The longest wait in seconds, a day as in asyncio: `epoll` takes no more than 24 days.
_LONGEST: Final = 86400.0
#: Looking these up in their module would cost as much as calling them.
_now: Final = monotonic
_INF: Final = inf
#: Events of epoll: a descriptor can be read from, or written to.
_READABLE: Final = select.EPOLLIN
_WRITABLE: Final = select.EPOLLOUT


class Callback:
    """The callback of an asyncio handle, as one call without the handle."""

    def __init__(self, handle: asyncio.Handle) -> None:
        self.handle = handle
        self.call: Callable[[], object] = partial(handle._context.run, handle._callback, *handle._args)  # type: ignore[attr-defined]  # noqa: SLF001
        #: Whether the handle waits no more. Asking the handle would be slower: its class is not compiled.
        self.is_over = False


#: The callbacks of a descriptor: to read, and to write.
Callbacks = tuple[Callback | None, Callback | None]


class Waiter:
    """Waits with `epoll`, whose own descriptor is `descriptor`, and calls what is ready or due.

    `callbacks` has a descriptor as key. The loop that it serves sets three attributes: `ready`, the handles that the
    loop calls itself; `call_soon`, which adds a callback to them; and `failed`, which takes the error of a callback.
    Handles that are in `ready` when a wait begins are called first, as in asyncio.
    """

    def __init__(self, epoll: select.epoll, descriptor: int) -> None:
        self.callbacks: dict[int, Callbacks] = {}
        self.ready: deque[asyncio.Handle] = deque()
        self.call_soon: Callable[[Callable[[], None]], object] = _serves_no_loop
        self.failed: Callable[[BaseException], None] = _serves_no_loop
        self._epoll = epoll
        self._descriptor = descriptor
        self._masked: set[int] = set()
        #: Times and callbacks; the number between them keeps the order of equal times.
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0
        self._ends_at = 0.0
        #: Whether callbacks are added to `ready` instead of called, because others are there already.
        self._is_behind = False

    def wait(self, timeout: float | None = None) -> list[asyncio.Handle]:
        """Wait, and call what is ready or due, for `timeout` seconds or until the loop has something to do.

        Returns an empty list: the loop has no events to process.
        """
        self._is_behind = bool(self.ready)
        now = _now()
        self._ends_at = _INF if timeout is None else now + timeout
        while True:
            due = self._due[0][0] if self._due else _INF
            wait = min(self._ends_at, due) - now
            self._poll(min(wait, _LONGEST))
            now = _now()
            self._call_due(now)
            if self.ready or self._ends_at <= now:
                return []

    def wake_at(self, when: float, callback: Callable[[], None]) -> None:
        """Call `callback` at `when`. This costs much less than a timer of the loop, and cannot be cancelled."""
        self._number += 1
        heappush(self._due, (when, self._number, callback))

    def end_by(self, when: float) -> None:
        """End the wait at `when` at the latest: the loop has a new timer."""
        self._ends_at = min(self._ends_at, when)

    def register(self, descriptor: int, handles: tuple[asyncio.Handle | None, asyncio.Handle | None]) -> None:
        """Have these handles wait for the descriptor: one to read, one to write."""
        reader, writer = handles
        self._end(descriptor, reader, writer)
        self.callbacks[descriptor] = (
            None if reader is None else Callback(reader),
            None if writer is None else Callback(writer),
        )
        if descriptor in self._masked:
            self.mask(descriptor, is_masked=reader is not None)

    def unregister(self, descriptor: int) -> None:
        """Forget the descriptor: nothing waits for it any more."""
        self._end(descriptor)
        del self.callbacks[descriptor]
        self._masked.discard(descriptor)

    def mask(self, descriptor: int, *, is_masked: bool) -> None:
        """Stop reading from a descriptor, but notice when its connection is lost; unless `is_masked`, read again.

        This takes a fifth of the time of unregistering and registering.
        """
        reader, writer = self.callbacks[descriptor]
        if is_masked:
            self._masked.add(descriptor)
        else:
            self._masked.discard(descriptor)
        reading = 0 if is_masked or reader is None else _READABLE
        self._epoll.modify(descriptor, reading if writer is None else reading | _WRITABLE)

    def _end(self, descriptor: int, *going_on: asyncio.Handle | None) -> None:
        """End the callbacks of a descriptor, even those that are ready, except for the handles `going_on`."""
        for callback in self.callbacks.get(descriptor) or ():
            if callback is not None and callback.handle not in going_on:
                callback.is_over = True

    def _poll(self, timeout: float) -> None:
        """Wait once, for `timeout` seconds or less, and call what is ready."""
        if timeout <= 0.0:
            self._call_ready(0.0)
        elif self._descriptor >= SELECTABLE:
            self._call_ready(timeout)
        elif timeout > EXACT_PART:
            self._call_ready(timeout - EXACT_PART)
        elif select.select((self._descriptor,), (), (), timeout)[0]:
            self._call_ready(0.0)

    def _call_ready(self, wait: float) -> None:
        """Call the callbacks that are ready within `wait` seconds, except those that another one has just ended.

        If others must be called first, leave them to the loop.
        """
        ready = []
        for descriptor, events in self._epoll.poll(wait, _BATCH):
            callbacks = self.callbacks.get(descriptor)
            if callbacks is None:
                continue
            reader, writer = callbacks
            if reader is not None and events & ~_WRITABLE:  # the end of a connection is for both
                ready.append(reader)
            if writer is not None and events & ~_READABLE:
                ready.append(writer)
        for callback in ready:
            if self._is_behind:
                self.ready.append(callback.handle)
            elif not callback.is_over:
                self._call(callback.call)

    def _call_due(self, now: float) -> None:
        """Call what is due, but not yet what these calls add: ready descriptors come first."""
        last = self._number
        while self._due and self._due[0][0] <= now and self._due[0][1] <= last:
            callback = heappop(self._due)[2]
            if self._is_behind:
                self.call_soon(callback)
            else:
                self._call(callback)

    def _call(self, callback: Callable[[], object]) -> None:
        try:
            callback()
        except (SystemExit, KeyboardInterrupt):
            raise
        except BaseException as error:  # noqa: BLE001 - CancelledError too: an event loop reports the errors of callbacks and goes on
            self.failed(error)


def _serves_no_loop(_: object) -> None:
    """Raise RuntimeError: there is no loop yet."""
    raise RuntimeError("the waiter serves no loop yet")
