"""Events for followers of a running gateway, beside the log.

Followers are less important than all else: each has a bounded queue and loses everything when it is full, and only the
first events of a second are handed on.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import time
from typing import Final

from gateway.clock.times import rfc_3339
from gateway.events import Emit, Event, Level
from gateway.observe.last_events import LastEvents

#: The most events that wait for one follower.
MOST_WAITING: Final = 256
#: The most events that are handed on in a second; further ones are counted.
MOST_IN_A_SECOND: Final = 100
#: The fields with bytes of a line: None for followers who may not read every unit.
BYTES: Final = ("heard", "frame")


class Follower:
    """The events for one follower. `is_lost` once there were more than can wait; there are none from then on.

    `may_see_bytes` tells whether the follower may see the bytes of lines at present.
    """

    def __init__(self, may_see_bytes: Callable[[], bool]) -> None:
        self.is_lost = False
        self.may_see_bytes: Final = may_see_bytes
        self._waiting: deque[str] = deque()
        self._has_some = asyncio.Event()

    def put(self, text: str) -> None:
        """Queue an event, as JSON."""
        if len(self._waiting) >= MOST_WAITING:
            self.is_lost = True
            self._waiting.clear()
        elif not self.is_lost:
            self._waiting.append(text)
        self._has_some.set()

    async def next(self, patience: float) -> list[str]:
        """Wait for events; return them as JSON, none after `patience` seconds or if the follower is lost."""
        try:
            async with asyncio.timeout(patience):
                await self._has_some.wait()
        except TimeoutError:
            return []
        self._has_some.clear()
        texts = list(self._waiting)
        self._waiting.clear()
        return texts


class FanOut:
    """Hands events on: all to the log by `emit`, and those from INFO on to the `last` ones and to all followers.

    Any thread may emit.
    """

    def __init__(self, emit: Emit, last: LastEvents | None = None) -> None:
        self.last: Final = last or LastEvents()
        self._emit = emit
        self._loop: asyncio.AbstractEventLoop | None = None
        self._followers: set[Follower] = set()
        self._second = 0
        self._handed_on = 0
        self._left_out = 0

    def emit(self, event: Event) -> None:
        """Hand on an event. Never raises or blocks."""
        self._emit(event)
        self.last.add(event)
        if self._followers and event.level >= Level.INFO and self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._spread, event)

    @contextmanager
    def following(self, may_see_bytes: Callable[[], bool] = lambda: True) -> Iterator[Follower]:
        """Yield a follower, which gets events until the context ends. Must be entered in the event loop."""
        self._loop = asyncio.get_running_loop()
        follower = Follower(may_see_bytes)
        self._followers.add(follower)
        try:
            yield follower
        finally:
            self._followers.discard(follower)

    def _spread(self, event: Event) -> None:
        second = int(asyncio.get_running_loop().time())
        if second != self._second:
            self._tell_left_out()
            self._second, self._handed_on = second, 0
        self._handed_on += 1
        if self._handed_on > MOST_IN_A_SECOND:
            self._left_out += 1
            return
        level = event.level.name.lower()
        self._put({**event.fields(), "event": event.name, "level": level})

    def _tell_left_out(self) -> None:
        if self._left_out:
            self._put({"count": self._left_out, "event": "events_left_out", "level": "warning"})
            self._left_out = 0

    def _put(self, fields: dict[str, object]) -> None:
        fields = {**fields, "timestamp": rfc_3339(time())}
        text = json.dumps(fields, default=repr)
        hidden = {name: None for name in BYTES if name in fields}
        without = json.dumps({**fields, **hidden}, default=repr) if hidden else text
        for follower in self._followers:
            follower.put(text if not hidden or follower.may_see_bytes() else without)
