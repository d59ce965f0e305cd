"""https:// connections: their handshakes are done as those of tls:// listeners, and then aiohttp serves them."""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, Final, cast

from aiohttp import web

from gateway.listeners.handshakes import ConnectingClient, Handshakes
from gateway.listeners.tls_stream import TlsStream
from gateway.request import Caller
from gateway.web.front.pieces import InPieces

#: How often it is looked for handshakes that take too long, while there are any, in seconds.
_SWEEP_STEP: Final = 1.0


class SecuredStream(TlsStream):
    """A connection that delivers one buffer in a turn of the event loop, as a socket does.

    It also gives its socket: aiohttp and `streams` set its options, and nobody may write to it.
    """

    _has_had_its_turn = False

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """See asyncio.BaseTransport."""
        return self._transport.get_extra_info(name, default)

    @property
    def _is_held(self) -> bool:
        return self._has_had_its_turn or super()._is_held

    def give_way(self) -> None:
        """Deliver nothing more until other connections have had their turn."""
        self._has_had_its_turn = True
        self._transport.pause_reading()
        asyncio.get_running_loop().call_soon(self._take_turn)

    def _take_turn(self) -> None:
        self._has_had_its_turn = False
        self._go_on()


class SecuredConnections:
    """Does handshakes: a bounded number, for a bounded time, and for a share of the time only."""

    def __init__(self, serve: Callable[[], web.RequestHandler]) -> None:
        self._serve = serve
        self._handshakes = Handshakes(self._secured, lambda *_: None)
        self._sweeping: asyncio.TimerHandle | None = None

    def has_room(self, share_key: str, now: float) -> bool:
        """Whether a handshake can begin with a client from there, perhaps after another was ended."""
        return not self._handshakes.make_room(share_key, now)

    def stream(self, context: ssl.SSLContext) -> SecuredStream:
        """What is the protocol of a new connection; `begin` its handshake at once."""
        return SecuredStream(context, self._handshakes)

    def begin(self, stream: SecuredStream, host: str, share_key: str) -> None:
        """A client has connected; it is served once its handshake is done."""
        loop = asyncio.get_running_loop()
        self._handshakes.begin(stream, ConnectingClient(Caller(host, host, share_key)), loop.time())
        if self._sweeping is None:
            self._sweeping = loop.call_later(_SWEEP_STEP, self._sweep)

    def close(self) -> None:
        """End all handshakes."""
        self._handshakes.close()
        if self._sweeping is not None:
            self._sweeping.cancel()

    def _secured(self, stream: TlsStream, _connecting: ConnectingClient) -> None:
        stream.begin(_Secured(self._serve(), cast("SecuredStream", stream)))

    def _sweep(self) -> None:
        loop = asyncio.get_running_loop()
        self._handshakes.sweep(loop.time())
        self._sweeping = loop.call_later(_SWEEP_STEP, self._sweep) if len(self._handshakes) else None


class _Secured(InPieces):
    """What was decrypted may be more than a buffer."""

    def __init__(self, handler: web.RequestHandler, stream: SecuredStream) -> None:
        super().__init__(handler)
        self._stream = stream

    def buffer_updated(self, nbytes: int) -> None:
        """See asyncio.BufferedProtocol."""
        super().buffer_updated(nbytes)
        self._stream.give_way()
