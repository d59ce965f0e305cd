"""Events for the program that the gateway is a part of."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from contextlib import suppress
from threading import Lock
from typing import Final, Self
from weakref import ref

from gateway.events import Emit, Event, EventsDropped, Level, WriteAudit

#: The most events that wait for one reader.
MOST_WAITING: Final = 10_000


class EventStreams:
    """Hands events on: all by `emit`, and those from INFO on to each open stream. Any thread may emit."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit
        #: Replaced as a whole, as any thread may be amid them.
        self._streams: tuple[ref[EventStream], ...] = ()
        self._opening = Lock()
        self._is_closed = False

    def emit(self, event: Event) -> None:
        """Hand on an event. Never raises or blocks."""
        self._emit(event)
        if event.level >= Level.INFO:
            self._put(event)

    def open(self) -> "EventStream":
        """Open a stream of the events from now on. One that nobody refers to any more is gone."""
        stream = EventStream()
        with self._opening:
            self._streams = (*(each for each in self._streams if each() is not None), ref(stream))
        if self._is_closed:
            stream.put(None)
        return stream

    def close(self) -> None:
        """Let all streams end."""
        self._is_closed = True
        self._put(None)

    def _put(self, event: Event | None) -> None:
        for each in self._streams:
            stream = each()
            if stream is not None:
                stream.put(event)


class EventStream(AsyncIterator[Event]):
    """The events since it was opened, until the gateway has stopped; for one reader, in any loop.

    When MOST_WAITING wait, further ones are dropped. Where they are missing, an `EventsDropped` tells their number.
    """

    def __init__(self) -> None:
        self._waiting: deque[Event | None] = deque()
        self._dropped = self._dropped_audits = 0
        self._waiter: asyncio.Future[None] | None = None

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Event:
        """Return the next event.

        Raises:
            RuntimeError: another reader waits for it.
        """
        while not self._waiting:
            if self._waiter is not None and not self._waiter.done():
                raise RuntimeError("a stream of events is for one reader: open one for each, by gateway.events()")
            waiter = self._waiter = asyncio.get_running_loop().create_future()
            if self._waiting:  # some came before there was somebody to wake
                self._waiter = None
            else:
                await waiter
        event = self._waiting.popleft()
        if event is None:
            self._waiting.append(None)
            raise StopAsyncIteration
        return event

    def put(self, event: Event | None) -> None:
        """Add an event, or the end. Never raises or blocks."""
        if event is not None and len(self._waiting) >= MOST_WAITING:
            self._dropped += 1
            self._dropped_audits += isinstance(event, WriteAudit)
            return
        if self._dropped:
            self._waiting.append(EventsDropped(self._dropped, self._dropped_audits))
            self._dropped = self._dropped_audits = 0
        self._waiting.append(event)
        waiter, self._waiter = self._waiter, None
        if waiter is not None:
            with suppress(RuntimeError):  # the reader's loop has ended
                waiter.get_loop().call_soon_threadsafe(_wake, waiter)


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
