"""The waiting of the event loop, with calls for ready descriptors and due times. Compiled (ADR 12).

asyncio waits in `epoll_wait`, which counts in milliseconds. Above 19200 baud, t3.5 is 1.75 ms, so a millisecond is a
tenth of what a fast line can carry. How this waits instead: gateway/clock/system_calls.py. Why not a timer descriptor
for each line: docs/adr/0009-exact-timers.md
"""

import asyncio
import select
from collections import deque
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from math import inf
from time import monotonic
from typing import Any, Final

from gateway.clock.system_calls import Wait

#: The longest wait in seconds, a day as in asyncio: `epoll` takes no more than 24 days.
_LONGEST: Final = 86400.0
#: Looking these up in their module would cost as much as calling them.
_now: Final = monotonic
_INF: Final = inf
#: Events of epoll: a descriptor can be read from, or written to.
_READABLE: Final = select.EPOLLIN
_WRITABLE: Final = select.EPOLLOUT
#: In place of events: nobody knows which ones are reported.
_UNKNOWN: Final = -1


class Callback:
    """The callback of an asyncio handle, as one call without the handle."""

    def __init__(self, handle: asyncio.Handle) -> None:
        self.handle = handle
        self.call: Callable[[], object] = partial(handle._context.run, handle._callback, *handle._args)  # type: ignore[attr-defined]  # noqa: SLF001
        #: Whether the handle waits no more. Asking the handle would be slower: its class is not compiled.
        self.is_over = False


class Interest:
    """What waits for a descriptor, to read and to write, and which events its epoll reports."""

    def __init__(self, descriptor: int, reader: Callback | None, writer: Callback | None) -> None:
        self.descriptor: Final = descriptor
        self.reader: Final = reader
        self.writer: Final = writer
        #: Whether it is not to be read from.
        self.is_masked = False
        self.reported = self.wanted
        #: Whether another one has taken its place, or none.
        self.is_over = False

    @property
    def wanted(self) -> int:
        """The events to be reported; epoll adds the end of a connection."""
        reading = 0 if self.is_masked or self.reader is None else _READABLE
        return reading if self.writer is None else reading | _WRITABLE


class Waiter:
    """Waits with `wait_really` for the descriptors of `epoll`, and calls what is ready or due.

    The loop that it serves sets three attributes: `ready`, the handles that the loop calls itself; `call_soon`, which
    adds a callback to them; and `failed`, which takes the error of a callback. Handles that are in `ready` when a wait
    begins are called first, as in asyncio.
    """

    def __init__(self, epoll: select.epoll, wait_really: Wait) -> None:
        self.ready: deque[asyncio.Handle] = deque()
        self.call_soon: Callable[[Callable[[], None]], object] = _serves_no_loop
        self.failed: Callable[[BaseException], None] = _serves_no_loop
        self._epoll = epoll
        self._wait_really = wait_really
        #: By descriptor; and those whose events may have to be changed before the next wait.
        self._interests: dict[int, Interest] = {}
        self._changed: list[Interest] = []
        #: Times and callbacks; the number between them keeps the order of equal times. And whether they come before
        #: descriptors that are ready.
        self._due: list[tuple[float, int, Callable[[], None], bool]] = []
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
            if self._changed:
                self._report_changed()
            wait = min(min(self._ends_at, due) - now, _LONGEST)
            self._call_ready(self._wait_really(wait, self._interests))
            now = _now()
            self._call_due(now)
            if self.ready or self._ends_at <= now:
                return []

    def wake_at(self, when: float, callback: Callable[[], None], *, first: bool = False) -> None:
        """Call `callback` at `when`. This costs much less than a timer of the loop, and cannot be cancelled.

        One that is `first` does not wait for what is ready at that time: it must see itself what has arrived.
        """
        self._number += 1
        heappush(self._due, (when, self._number, callback, first))

    def end_by(self, when: float) -> None:
        """End the wait at `when` at the latest: the loop has a new timer."""
        self._ends_at = min(self._ends_at, when)

    def register(self, descriptor: int, handles: tuple[asyncio.Handle | None, asyncio.Handle | None]) -> None:
        """Have these handles wait for the descriptor: one to read, one to write."""
        reader, writer = handles
        before = self._end(descriptor, reader, writer)
        interest = Interest(
            descriptor,
            None if reader is None else Callback(reader),
            None if writer is None else Callback(writer),
        )
        self._interests[descriptor] = interest
        if before is not None:
            interest.reported = _UNKNOWN  # a selector leaves alone what seems the same to it
            self._set_masked(interest, is_masked=before.is_masked and reader is not None)

    def unregister(self, descriptor: int) -> None:
        """Forget the descriptor: nothing waits for it any more."""
        self._end(descriptor)
        del self._interests[descriptor]

    def mask(self, descriptor: int) -> None:
        """Stop reading from a descriptor until `unmask`, but notice when its connection is lost.

        This takes a fifth of the time of unregistering and registering; and less if the opposite follows before the
        next wait.
        """
        self._set_masked(self._interests[descriptor], is_masked=True)

    def unmask(self, descriptor: int) -> None:
        """Read from a descriptor again."""
        self._set_masked(self._interests[descriptor], is_masked=False)

    def _set_masked(self, interest: Interest, *, is_masked: bool) -> None:
        interest.is_masked = is_masked
        self._changed.append(interest)

    def _report_changed(self) -> None:
        """Have epoll report what is wanted by now."""
        for interest in self._changed:
            wanted = interest.wanted
            if interest.reported != wanted and not interest.is_over:
                self._epoll.modify(interest.descriptor, wanted)
                interest.reported = wanted
        self._changed.clear()

    def _end(self, descriptor: int, *going_on: asyncio.Handle | None) -> Interest | None:
        """End the callbacks of a descriptor, even those that are ready, except for the handles `going_on`."""
        interest = self._interests.get(descriptor)
        if interest is not None:
            interest.is_over = True
            for callback in (interest.reader, interest.writer):
                if callback is not None and callback.handle not in going_on:
                    callback.is_over = True
        return interest

    def _call_ready(self, found: tuple[Any, ...]) -> None:
        """Call what waits for one of the events that a wait has found; the end of a connection is for both.

        Who was ready is known before any of it is called: it may close a descriptor, and another one have its number.
        """
        for at in range(0, len(found), 2):
            interest: Interest | None = found[at]
            events: int = found[at + 1]
            if interest is None:
                continue
            if interest.reader is not None and events & ~_WRITABLE:
                self._call_unless_over(interest.reader)
            if interest.writer is not None and events & ~_READABLE:
                self._call_unless_over(interest.writer)
            if at + 2 < len(found) and self._due and self._due[0][3] and not self._is_behind:
                self._call_first(_now())

    def _call_unless_over(self, callback: Callback) -> None:
        """Call it unless another one has just ended it. If others must be called first, leave it to the loop."""
        if self._is_behind:
            self.ready.append(callback.handle)
        elif not callback.is_over:
            self._call(callback.call)

    def _call_first(self, now: float) -> None:
        """Call what is due and does not wait for ready descriptors, but not yet what these calls add."""
        last = self._number
        while self._due and self._due[0][0] <= now and self._due[0][1] <= last and self._due[0][3]:
            self._call(heappop(self._due)[2])

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
