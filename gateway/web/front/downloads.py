"""Files that are made while they are sent: a bounded number, and none that waits for a reader for long."""

import asyncio
from collections.abc import AsyncIterator
from typing import Final, Literal

from aiohttp import web

from gateway.errors import WrongQuestion
from gateway.web.front.problems import ProblemError
from gateway.web.front.streams import WRITE_TIME, bound_buffers, drop

#: Files that are sent at a time.
MOST_DOWNLOADS: Final = 4

#: The content types of files, by the end of their names.
_TYPES: Final = {"pcapng": "application/x-pcapng", "tar.gz": "application/gzip"}


class Downloads:
    """The files that are being sent."""

    def __init__(self) -> None:
        self._number = 0

    async def serve(
        self, request: web.Request, parts: AsyncIterator[bytes], kind: Literal["pcapng", "tar.gz"] = "pcapng"
    ) -> web.StreamResponse:
        """Send a file of this kind; a client that takes nothing of it for some seconds is dropped.

        Raises:
            ProblemError: there are too many.
        """
        if self._number >= MOST_DOWNLOADS:
            raise ProblemError(503, f"{MOST_DOWNLOADS} others are being sent", {"Retry-After": "10"})
        self._number += 1
        try:
            return await _send(request, parts, kind)
        finally:
            self._number -= 1


async def _send(request: web.Request, parts: AsyncIterator[bytes], kind: str) -> web.StreamResponse:
    part = await anext(parts)  # which may raise, and then there is a problem in place of a file
    headers = {
        "Content-Type": _TYPES[kind],
        "Content-Disposition": f'attachment; filename="modbus-gateway.{kind}"',
        "Cache-Control": "no-store",
    }
    response = web.StreamResponse(headers=headers)
    await response.prepare(request)
    bound_buffers(request.transport)
    try:
        await _write(response, part)
        async for part in parts:
            await _write(response, part)
    except (OSError, TimeoutError, WrongQuestion):
        drop(request.transport)
    return response


async def _write(response: web.StreamResponse, part: bytes) -> None:
    async with asyncio.timeout(WRITE_TIME):
        await response.write(part)
