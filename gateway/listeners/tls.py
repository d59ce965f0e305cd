"""TLS listeners: Modbus/TCP Security (mbaps). Each client shows a certificate, which names its role."""

import asyncio
import socket
import time
from dataclasses import replace
from functools import lru_cache, partial
from typing import Final

from gateway import events
from gateway.listeners.admission import NO_RIGHTS
from gateway.listeners.connection import SecuredConnection
from gateway.listeners.handshakes import ConnectingClient, Handshakes
from gateway.listeners.kept_sessions import KeptSessions
from gateway.listeners.settings import ListenSettings
from gateway.listeners.tcp import TcpListener
from gateway.listeners.tls_stream import TlsStream
from gateway.request import Caller
from gateway.routing.router import Router
from gateway.tls.certificate import Certificate, parse_certificate, shorten
from gateway.tls.contexts import Loaded, stop_resuming
from gateway.tls.settings import ServerTls
from gateway.tls.store import TlsStore

#: The reason for rejecting a client that resumes an earlier session.
OUTLIVED: Final = "its session is older than the end of an authority's certificate, or of a revocation list"


class TlsListener(TcpListener):
    """A `[[listen]]` table with tls://.

    A client counts for `clients`, and may replace another one, once its handshake is done.
    """

    #: With a shorter pause clients of other listeners would be delayed, even if all new ones are rejected; the system
    #: keeps these waiting.
    pause_between_clients = 0.005

    def __init__(self, settings: ListenSettings, router: Router, emit: events.Emit, store: TlsStore) -> None:
        super().__init__(settings, router, emit)
        self._store = store
        self._handshakes = Handshakes(self._secured, self._rejected)
        self._trust = b""
        self._kept = KeptSessions(self._files, lambda: self._loaded, partial(store.renew, self._files))

    def start(self) -> None:
        """Accept clients."""
        self._trust = self._loaded.trust
        super().start()

    def finish(self) -> None:
        """Accept no more clients or requests, and end handshakes; close each client once it has its responses."""
        self._handshakes.close()
        super().finish()

    def close(self) -> None:
        """Accept no more clients, end handshakes, and abort every connection."""
        self._handshakes.close()
        super().close()

    def renew(self) -> None:
        """Make all clients connect again if a reload has changed which clients are trusted."""
        trust, self._trust = self._trust, self._loaded.trust
        if trust != self._trust:
            self._handshakes.close()
            for connection in self.connections:
                connection.finish("the authority or its revocation list has changed")

    @property
    def _files(self) -> ServerTls:
        assert isinstance(self.settings.tls, ServerTls)  # noqa: S101 - the config ensures it
        return self.settings.tls

    @property
    def _loaded(self) -> Loaded:
        return self._store[self._files]

    def _make_room(self, caller: Caller, now: float) -> str:
        """Make room for a handshake. Return why none is begun; empty if one is."""
        if not self.router.rights.admits(caller.host):
            return NO_RIGHTS
        return self._handshakes.make_room(caller.share_key, now)

    async def _serve(self, sock: socket.socket, caller: Caller) -> None:
        loop, loaded = asyncio.get_running_loop(), self._loaded
        if time.time() > loaded.resumable_until:
            stop_resuming(loaded.context)
        stream = TlsStream(loaded.context, self._handshakes)
        await loop.connect_accepted_socket(lambda: stream, sock)
        if loaded is not self._loaded:  # a reload may have changed which clients are trusted
            stream.abort()
            return
        self._handshakes.begin(stream, ConnectingClient(caller, loaded.resumable_until), loop.time())

    def _secured(self, stream: TlsStream, connecting: ConnectingClient) -> None:
        """Serve a client with a valid certificate, if there is room for it."""
        now = asyncio.get_running_loop().time()
        if stream.is_resumed and time.time() > connecting.resumable_until:
            self._reject(stream, connecting, OUTLIVED)
            return
        try:
            certificate = _parsed(stream.peer_certificate)
            caller = _identify(connecting.caller, certificate)
        except ValueError as wrong:
            self._reject(stream, connecting, f"its certificate cannot be used: {wrong}")
            return
        rights, role = self.router.rights, caller.role
        why_not = self.connections.make_room(caller, rights, self.settings, now, self._reject_replaced, role)
        if why_not:
            self._reject(stream, connecting, why_not)
            return
        connection = SecuredConnection(self, caller, asyncio.get_running_loop().time, self.router)
        connection.valid_until, connection.role = certificate.not_after, role
        stream.begin(connection)

    def _reject(self, stream: TlsStream, connecting: ConnectingClient, reason: str) -> None:
        self._rejected(connecting, reason)
        stream.close()

    def _rejected(self, connecting: ConnectingClient, reason: str) -> None:
        self.rejected(connecting.caller.client, reason)

    @property
    def _must_sweep(self) -> bool:
        return True  # handshakes and kept sessions too

    def _sweep(self) -> None:
        self._handshakes.sweep(asyncio.get_running_loop().time())
        self._kept.limit()
        super()._sweep()


#: Clients that connect again show the same certificate; parsing takes a large part of the loop's time for a handshake.
_parsed = lru_cache(maxsize=256)(parse_certificate)


def _identify(caller: Caller, certificate: Certificate) -> Caller:
    """Add subject and role of the certificate to a caller.

    Raises:
        ValueError: the certificate is not valid now, which a resumed session does not check, or its role violates the
            specification.
    """
    if not certificate.not_before <= time.time() <= certificate.not_after:
        raise ValueError("it is not valid now")
    return replace(caller, subject=shorten(certificate.subject), role=certificate.role)
