"""https:// connections: their handshakes are done as those of tls:// listeners, and then aiohttp serves them."""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, Final, cast

from aiohttp import web

from gateway.listeners.connection import Stream
from gateway.listeners.handshakes import ConnectingClient, Handshakes
from gateway.listeners.tls_stream import TlsStream

#: How often it is looked for handshakes that take too long, while there are any, in seconds.
_SWEEP_STEP: Final = 1.0
#: What was decrypted is handed on at once: one buffer for all connections.
_BUFFER: Final = memoryview(bytearray(16 * 1024))


class SecuredStream(TlsStream):
    """A connection that also gives its socket: aiohttp and `streams` set its options, and nobody may write to it."""

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """See asyncio.BaseTransport."""
        return self._transport.get_extra_info(name, default)


class SecuredConnections:
    """Does handshakes: a bounded number, for a bounded time, and for a share of the time only."""

    def __init__(self, serve: Callable[[], web.RequestHandler]) -> None:
        self._serve = serve
        self._handshakes = Handshakes(self._secured, lambda *_: None)
        self._sweeping: asyncio.TimerHandle | None = None

    def has_room(self, origin: str) -> bool:
        """Whether a handshake can begin with a client from there, perhaps after another was ended."""
        return not self._handshakes.trouble(origin)

    def stream(self, context: ssl.SSLContext) -> SecuredStream:
        """What is the protocol of a new connection; `begin` its handshake at once."""
        return SecuredStream(context, self._handshakes)

    def begin(self, stream: SecuredStream, host: str, origin: str) -> None:
        """A client has connected; it is served once its handshake is done."""
        loop = asyncio.get_running_loop()
        self._handshakes.begin(stream, ConnectingClient(host, host, origin), loop.time())
        if self._sweeping is None:
            self._sweeping = loop.call_later(_SWEEP_STEP, self._sweep)

    def close(self) -> None:
        """End all handshakes."""
        self._handshakes.close()
        if self._sweeping is not None:
            self._sweeping.cancel()

    def _secured(self, stream: TlsStream, _connecting: ConnectingClient) -> None:
        stream.begin(_Served(self._serve()))

    def _sweep(self) -> None:
        loop = asyncio.get_running_loop()
        self._handshakes.sweep(loop.time())
        self._sweeping = loop.call_later(_SWEEP_STEP, self._sweep) if len(self._handshakes) else None


class _Served:
    """The application of a stream, which hands on to a `handler` what was decrypted."""

    def __init__(self, handler: web.RequestHandler) -> None:
        self._handler = handler
        self.connection_lost: Final = handler.connection_lost
        self.pause_writing: Final = handler.pause_writing
        self.resume_writing: Final = handler.resume_writing

    def connection_made(self, stream: Stream) -> None:
        """See Application."""
        self._stream = stream
        self._handler.connection_made(cast("asyncio.Transport", stream))

    def get_buffer(self) -> memoryview:
        """See Application."""
        return _BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        """See Application."""
        self._handler.data_received(bytes(_BUFFER[:nbytes]))

    def eof_received(self) -> bool:
        """The client asks nothing more: as without TLS, it gets no more either."""
        self._stream.close()
        return False

    def reject(self, reason: str) -> None:  # noqa: ARG002 - the log has no place for it
        """See Application."""
        self._stream.close()
