"""What is done for one request at a time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from aiohttp import web


class Turns:
    """Lets one request in at a time, in the order in which they came.

    The server does not end a handler when its client goes: without this, whoever asks and goes, again and again,
    would have everybody else wait for work that nobody wants.
    """

    def __init__(self) -> None:
        self._lock = asyncio.Lock()

    @asynccontextmanager
    async def turn(self, request: web.Request) -> AsyncIterator[None]:
        """The turn of this request.

        Raises:
            HTTPServiceUnavailable: its client has gone meanwhile.
        """
        async with self._lock:
            if has_gone(request):
                raise web.HTTPServiceUnavailable(text="the client has gone")
            yield


def has_gone(request: web.Request) -> bool:
    """Whether nobody waits for the response any more."""
    return request.transport is None or request.transport.is_closing()
