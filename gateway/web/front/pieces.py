"""Adapts aiohttp's handler of a connection to transports that deliver into a buffer, a TLS stream among them.

A socket delivers a bounded piece in each turn of the event loop. asyncio itself would hand on 256 KiB, and aiohttp
keeps what it does not parse at once.
"""

import asyncio
from typing import Final, cast

from aiohttp import web

from gateway.listeners.connection import Stream

#: The most bytes that are handed on at once.
PIECE: Final = 16 * 1024
#: They are received into this, and taken out at once: one for all connections.
_BUFFER: Final = memoryview(bytearray(PIECE))


class InPieces(asyncio.BufferedProtocol):
    """Passes what a transport, of a socket or of TLS, receives to the `handler` of its requests."""

    def __init__(self, handler: web.RequestHandler) -> None:
        self._handler = handler

    def connection_made(self, transport: asyncio.BaseTransport | Stream) -> None:
        """See asyncio.BaseProtocol."""
        self._transport = cast("asyncio.Transport", transport)
        self._handler.connection_made(self._transport)

    def get_buffer(self, sizehint: int = -1) -> memoryview:  # noqa: ARG002 - a transport asks for as much as it likes
        """See asyncio.BufferedProtocol."""
        return _BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        """See asyncio.BufferedProtocol."""
        self._handler.data_received(bytes(_BUFFER[:nbytes]))

    def pause_writing(self) -> None:
        """See asyncio.BaseProtocol."""
        self._handler.pause_writing()

    def resume_writing(self) -> None:
        """See asyncio.BaseProtocol."""
        self._handler.resume_writing()

    def connection_lost(self, exc: BaseException | None) -> None:
        """See asyncio.BaseProtocol."""
        self._handler.connection_lost(exc)

    def eof_received(self) -> bool:
        """Close: the client sends no more requests, and gets no more responses either."""
        self._transport.close()
        return False

    def reject(self, reason: str) -> None:  # noqa: ARG002 - the log has no place for it
        """Close because of what the client did in TLS."""
        self._transport.close()
