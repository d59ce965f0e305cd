"""Work that is done for one request at a time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web


class Turns:
    """Admits one request at a time, in the order in which they came.

    The server does not end a handler when its client disconnects: without this, a client that asks and disconnects
    again and again would make all others wait for work that is no longer wanted.
    """

    def __init__(self) -> None:
        self._lock = asyncio.Lock()

    @asynccontextmanager
    async def turn(self, request: web.Request) -> AsyncIterator[None]:
        """Wait for the turn of this request, and keep it inside the context.

        Raises:
            HTTPServiceUnavailable: its client has gone meanwhile.
        """
        async with self._lock:
            if not is_there(request):
                raise web.HTTPServiceUnavailable(text="the client has gone")
            yield


def is_there(request: web.Request) -> bool:
    """Return whether the client still waits."""
    return request.transport is not None and not request.transport.is_closing()
