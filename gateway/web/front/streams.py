"""Server-sent events: a bounded number of readers, and none that costs the lines anything.

A client that does not read is dropped: once more events wait for it than there is room for, or when it takes none for
some seconds. Its browser connects again by itself.
"""

import asyncio
import socket
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final, Protocol

from aiohttp import web

from gateway.listeners.share_keys import ShareKeys
from gateway.web.access.guard import Visitor
from gateway.web.front.problems import ProblemError

#: Readers at a time; fewer than connections, so that all else finds room. For a new one, a user at an address with more
#: than this many loses the oldest.
MOST_READERS: Final = 64
MOST_OF_ONE: Final = 8
#: How long a reader may take nothing, and how often there is a sign of life, in seconds.
WRITE_TIME: Final = 10.0
HEARTBEAT: Final = 15.0
#: What the system keeps for one reader, and what this process does, in bytes.
_KERNEL_BUFFER: Final = 64 * 1024
_OWN_BUFFER: Final = 64 * 1024

_HEADERS: Final = {"Content-Type": "text/event-stream", "Cache-Control": "no-store", "X-Accel-Buffering": "no"}

_Reader = tuple[str, str]


class EventSource(Protocol):
    """The events for one reader, or the trace."""

    @property
    def is_lost(self) -> bool:
        """Whether to drop the reader: more events wait than may, or what it reads no longer exists."""

    async def next(self, patience: float) -> Sequence[str]:
        """Return the events that wait, as JSON; empty if none comes within `patience` seconds."""


class Streams:
    """The open streams."""

    def __init__(self) -> None:
        #: The readers, as user and address, oldest first.
        self._readers: dict[asyncio.Task[None], _Reader] = {}
        self._share_keys = ShareKeys()

    def __len__(self) -> int:
        return len(self._readers)

    async def serve(
        self, request: web.Request, source: EventSource, visitor: Visitor, is_valid: Callable[[], bool]
    ) -> web.StreamResponse:
        """Send events until the reader leaves, is lost, is not `is_valid` any more, or all streams end.

        Raises:
            ProblemError: there are too many readers.
        """
        reader = visitor.user, self._share_keys.of(visitor.host, asyncio.get_running_loop().time())
        if len(self._readers) >= MOST_READERS and not self._make_room(reader):
            raise ProblemError(503, f"{MOST_READERS} others read already", {"Retry-After": "30"})
        response = web.StreamResponse(headers=_HEADERS)
        task = asyncio.create_task(_send(request, response, source, is_valid), name="web events")
        self._readers[task] = reader
        task.add_done_callback(lambda task: self._readers.pop(task, None))
        try:
            await asyncio.wait({task})
        finally:
            task.cancel()
        with suppress(OSError, TimeoutError, asyncio.CancelledError):
            task.result()
            return response
        drop(request.transport)
        return response

    def end(self) -> None:
        """End all streams."""
        for task in self._readers:
            task.cancel()

    def _make_room(self, new: _Reader) -> bool:
        """End the oldest stream of the reader that has most; return False if all have few, or `new` is that reader."""
        most, number = Counter(self._readers.values()).most_common(1)[0]
        if number <= MOST_OF_ONE or new == most:
            return False
        oldest = next(task for task, reader in self._readers.items() if reader == most)
        del self._readers[oldest]
        return oldest.cancel()


async def _send(
    request: web.Request, response: web.StreamResponse, source: EventSource, is_valid: Callable[[], bool]
) -> None:
    await response.prepare(request)
    bound_buffers(request.transport)
    await _write(response, "retry: 3000\n\n")
    while is_valid():
        texts = await source.next(HEARTBEAT)
        if source.is_lost:
            raise TimeoutError
        await _write(response, "".join(_messages(texts)) or ": \n\n")


def _messages(texts: Iterable[str]) -> Iterable[str]:
    return (f"data: {text}\n\n" for text in texts)


async def _write(response: web.StreamResponse, text: str) -> None:
    async with asyncio.timeout(WRITE_TIME):
        await response.write(text.encode())


def bound_buffers(transport: asyncio.Transport | None) -> None:
    """Limit what is kept for a client that does not read."""
    if transport is not None:
        transport.set_write_buffer_limits(high=_OWN_BUFFER)
        _set(transport, socket.SO_SNDBUF, _KERNEL_BUFFER)


def drop(transport: asyncio.Transport | None) -> None:
    """Close a connection at once, and discard what the system still has to send."""
    if transport is not None:
        _set(transport, socket.SO_LINGER, struct.pack("ii", 1, 0))
        transport.abort()


def _set(transport: asyncio.Transport, option: int, value: int | bytes) -> None:
    with suppress(OSError, AttributeError):  # a connection that has gone
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, option, value)
