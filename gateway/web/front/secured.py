"""https:// connections: handshakes are done as for tls:// listeners, and then aiohttp serves them."""

import ssl
from collections.abc import Callable
from typing import Any

from aiohttp import web

from gateway.listeners.handshakes import ConnectingClient, Handshakes
from gateway.listeners.tls_stream import TlsStream
from gateway.request import Caller
from gateway.web.front.pieces import InPieces


class SecuredStream(TlsStream):
    """A connection that exposes its socket: aiohttp and `streams` set its options, and nothing may write to it."""

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """See asyncio.BaseTransport."""
        return self._transport.get_extra_info(name, default)


class SecuredConnections:
    """TLS handshakes: a bounded number, and only for a share of the time. Their deadline is that of connections."""

    def __init__(self, serve: Callable[[], web.RequestHandler]) -> None:
        self._serve = serve
        self._handshakes = Handshakes(self._secured, lambda *_: None)

    def has_room(self, share_key: str, now: float) -> bool:
        """Return whether a handshake can begin with a client from there, perhaps after ending another one."""
        return not self._handshakes.make_room(share_key, now)

    def stream(self, context: ssl.SSLContext) -> SecuredStream:
        """Make the protocol of a new connection; `begin` its handshake at once."""
        return SecuredStream(context, self._handshakes)

    def begin(self, stream: SecuredStream, host: str, share_key: str, now: float) -> None:
        """Begin the handshake of a client that has connected; it is served once that is done."""
        self._handshakes.begin(stream, ConnectingClient(Caller(host, host, share_key)), now)

    def close(self) -> None:
        """End all handshakes."""
        self._handshakes.close()

    def _secured(self, stream: TlsStream, _connecting: ConnectingClient) -> None:
        stream.begin(InPieces(self._serve()))
