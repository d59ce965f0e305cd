"""Events for those who follow them while the gateway runs, beside the log.

They are less important than all else: who follows has a bounded queue and loses everything when it is full, and of
many events in a second only the first ones are handed on.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from typing import Final

from gateway.events import Emit, Event, Level

#: Events that wait for one follower at most.
MOST_WAITING: Final = 256
#: Events in a second that are handed on; the others are counted.
MOST_IN_A_SECOND: Final = 100
#: The fields that have bytes of a line: None for whom may not read every unit.
_BYTES: Final = ("heard", "frame")


class Follower:
    """Somebody who follows. `is_lost` once there were more events than can wait; nothing comes from then on.

    `may_see_bytes` tells whether the bytes that were on a line may be told now.
    """

    def __init__(self, may_see_bytes: Callable[[], bool]) -> None:
        self.is_lost = False
        self.may_see_bytes: Final = may_see_bytes
        self._waiting: deque[str] = deque()
        self._has_some = asyncio.Event()

    def put(self, text: str) -> None:
        """Let an event wait."""
        if len(self._waiting) >= MOST_WAITING:
            self.is_lost = True
            self._waiting.clear()
        elif not self.is_lost:
            self._waiting.append(text)
        self._has_some.set()

    async def next(self, patience: float) -> list[str]:
        """The events that wait, as JSON; none if none has come within `patience` seconds, or it is lost."""
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
    """Hands events on: to the log by `emit`, and to all who follow, from INFO on. Any thread may emit."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit
        self._loop: asyncio.AbstractEventLoop | None = None
        self._followers: set[Follower] = set()
        self._second = 0
        self._handed_on = 0
        self._left_out = 0

    def emit(self, event: Event) -> None:
        """Hand on an event. It never raises and never blocks."""
        self._emit(event)
        if self._followers and event.level >= Level.INFO and self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._spread, event)

    @contextmanager
    def following(self, may_see_bytes: Callable[[], bool] = lambda: True) -> Iterator[Follower]:
        """In its context somebody follows, see Follower. To be entered in the event loop."""
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
        self._put({**event.fields(), "event": event.name, "level": level, "timestamp": _now()})

    def _tell_left_out(self) -> None:
        if self._left_out:
            self._put({"count": self._left_out, "event": "events_left_out", "level": "warning", "timestamp": _now()})
            self._left_out = 0

    def _put(self, fields: dict[str, object]) -> None:
        text = json.dumps(fields, default=repr)
        hidden = {name: None for name in _BYTES if name in fields}
        without = json.dumps({**fields, **hidden}, default=repr) if hidden else text
        for follower in self._followers:
            follower.put(text if not hidden or follower.may_see_bytes() else without)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
