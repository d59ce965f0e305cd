"""One secured connection: a protocol to the network, and a transport to the protocol of its client.

The handshake is done in steps that may run in a thread, because they take milliseconds of processor time. Everything
else runs in the event loop. (Not asyncio's own `ssl`: it keeps 256 KiB for each connection, and has no such steps.)
"""

from __future__ import annotations

import asyncio
import os
import ssl
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, Final, Protocol, cast

from gateway.listeners.connection import Stream
from gateway.listeners.kept_sessions import is_full
from gateway.tls.reasons import explain

#: The most bytes of a handshake: a chain of long certificates.
MOST_HANDSHAKE_BYTES: Final = 64 * 1024

#: The most bytes that a client may send beside its data, and how many more per byte of data: a record adds 30 at most.
#: The rest is for TLS itself: a client could otherwise keep us busy with thousands of key updates.
MOST_BESIDE_DATA: Final = 32 * 1024
BESIDE_EACH_BYTE: Final = 32
TOO_MUCH_BESIDE_DATA: Final = "it sends hardly anything but messages of TLS itself"

#: The buffer for encrypted bytes of all connections, which are taken out at once.
_BUFFER: Final = memoryview(bytearray(16 * 1024))


class Application(Protocol):
    """A buffered protocol, like TcpConnection."""

    def connection_made(self, stream: Stream) -> None:
        """Begin: the connection is secured."""

    def get_buffer(self) -> memoryview:
        """Return the buffer to deliver to; empty if there is no room at the moment."""

    def buffer_updated(self, nbytes: int) -> None:
        """Take the bytes delivered to that buffer."""

    def eof_received(self) -> bool:
        """Take note that the client has closed its side."""

    def pause_writing(self) -> None:
        """Stop writing: the client does not read."""

    def resume_writing(self) -> None:
        """Write again: the client reads."""

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection: it has ended."""

    def reject(self, reason: str) -> None:
        """Close because of the client's behaviour."""


class HandshakeOwner(Protocol):
    """The owner of the handshakes of connections."""

    def step_due(self, stream: TlsStream) -> None:
        """Call `step` in any thread, then `stepped`: bytes have arrived. Until then nothing more is received."""

    def secured(self, stream: TlsStream) -> None:
        """Call `begin` or `reject`: the handshake is done."""

    def not_secured(self, stream: TlsStream, reason: str) -> None:
        """Forget the stream: the handshake has failed, and the connection is closed."""


class TlsStream(asyncio.BufferedProtocol, asyncio.Transport):
    """The server's side of a connection."""

    def __init__(self, context: ssl.SSLContext, owner: HandshakeOwner) -> None:
        asyncio.Transport.__init__(self)
        self._owner = owner
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=True)
        #: The network, from `connection_made` on.
        self._transport: asyncio.Transport
        self._application: Application | None = None
        self._handshake_bytes = 0
        #: The remaining number of bytes beside data.
        self._spare = MOST_BESIDE_DATA
        #: Whether a step in a thread uses the objects of the handshake; nothing else may then.
        self._is_stepping = False
        self._has_started = False
        self._is_secured = False
        self._is_blocked = False
        self._is_paused = False
        #: Whether the network has ended, perhaps without an end in TLS; whether the application was told.
        self._is_cut_off = False
        self._has_peer_ended = False
        #: Why received bytes could not be decrypted; OpenSSL reports it only once.
        self._wrong = ""

    # --- the handshake ---

    def start(self) -> None:
        """Receive from now on: the owner knows the connection."""
        self._has_started = True
        self._transport.resume_reading()
        if self._handshake_bytes and not self.is_closing():
            self._order_step()

    def step(self) -> str | None:
        """Continue the handshake. Return None if more bytes are needed, "" if it is done, else why it has failed."""
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            return None
        except ssl.SSLError as error:
            return explain(error)
        return ""

    @property
    def has_response(self) -> bool:
        """Whether the last step has bytes for the client."""
        return self._outgoing.pending > 0

    def _order_step(self) -> None:
        self._transport.pause_reading()
        self._is_stepping = True
        self._owner.step_due(self)

    def stepped(self, outcome: str | None) -> None:
        """Act on the outcome of a step: send its bytes, and continue, begin or reject."""
        self._is_stepping = False
        if self.is_closing():
            return
        self._send()
        if outcome is None:
            self._transport.resume_reading()
        elif outcome:
            self.reject(outcome)
        else:
            self._is_secured = True
            self._owner.secured(self)

    def reject(self, reason: str) -> None:
        """Close the connection before it is secured or used."""
        self._owner.not_secured(self, reason)
        self.close()

    @property
    def is_resumed(self) -> bool:
        """Whether the client resumes an earlier session, at whose begin its certificate was checked."""
        return bool(self._tls.session_reused)

    @property
    def peer_certificate(self) -> bytes:
        """The client's certificate in DER; empty if it has shown none."""
        return self._tls.getpeercert(binary_form=True) or b""

    def begin(self, application: Application) -> None:
        """Be the transport of `application` from now on."""
        self._application = application
        application.connection_made(self)
        self._transport.resume_reading()
        self._deliver()

    # --- the protocol to the network ---

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the network connection, without receiving yet.

        Python 3.11.2 of Debian 12 receives nevertheless; these bytes are kept until `start`.
        """
        self._transport = cast("asyncio.Transport", transport)
        self._transport.pause_reading()

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - one buffer serves all
        """Return the buffer for encrypted bytes."""
        return _BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        """Take received encrypted bytes."""
        if self._application is not None:
            self._count(nbytes)
            self._deliver()
            return
        self._incoming.write(_BUFFER[:nbytes])
        self._handshake_bytes += nbytes
        if self._handshake_bytes > MOST_HANDSHAKE_BYTES:
            self.reject(f"its handshake is longer than {MOST_HANDSHAKE_BYTES} bytes")
            return
        if self._has_started:
            self._order_step()

    def eof_received(self) -> bool:
        """Note that the client has closed its side, perhaps not in TLS; requests are whole by their lengths."""
        if self._application is None:
            self.reject("it has closed the connection in the middle of the handshake")
            return False
        self._is_cut_off = True
        self._deliver()
        return True

    def pause_writing(self) -> None:
        """Stop reading from a client that does not read: TLS itself answers some records, such as KeyUpdate."""
        if self._application is not None:
            self._is_blocked = True
            self._transport.pause_reading()
            self._application.pause_writing()

    def resume_writing(self) -> None:
        """Read again from a client that reads."""
        if self._application is not None:
            self._is_blocked = False
            self._application.resume_writing()
            if not self._is_paused:
                self.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on the end of the connection, to the application or to the owner of the handshake."""
        application, self._application = self._application, None  # no cycle stays: see runtime.garbage
        if application is None:
            self._owner.not_secured(self, f"it was lost: {exc}" if exc else "it was closed")
        else:
            application.connection_lost(exc)

    # --- the transport to the application ---

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return information about the network connection, but never the socket: it would send plain text."""
        return default if name == "socket" else self._transport.get_extra_info(name, default)

    def is_closing(self) -> bool:
        """Tell whether it is closed, or being closed."""
        return self._transport.is_closing()

    def pause_reading(self) -> None:
        """Deliver nothing more. At most one buffer of encrypted bytes waits here."""
        self._is_paused = True
        self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Deliver received bytes soon, and then further ones."""
        self._is_paused = False
        self._go_on()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Set the limits of the network transport."""
        self._transport.set_write_buffer_limits(high, low)

    def get_write_buffer_size(self) -> int:
        """Return the number of encrypted bytes that wait to be sent."""
        return self._transport.get_write_buffer_size()

    def receive(self, room: memoryview) -> int:
        """Copy decrypted bytes into `room`. Return their number. The rest is delivered soon."""
        network = self._transport.get_extra_info("socket")
        if network is None or self._is_blocked or self._has_peer_ended or self._spare < 0 or self.is_closing():
            return 0
        count = self._take_waiting(room)  # first, so that at most one buffer waits
        if count == len(room):
            return count
        try:
            self._count(os.readv(network.fileno(), [_BUFFER]))
        except OSError:  # nothing has arrived, or the connection is lost: the loop sees that too
            return count
        asyncio.get_running_loop().call_soon(self._deliver)
        return count + self._take_waiting(room[count:])

    def write(self, data: bytes | bytearray | memoryview[Any]) -> None:
        """Encrypt and send, unless it is being closed."""
        if self.is_closing():
            return
        try:
            self._tls.write(data)
        except ssl.SSLError:
            if not self._wrong:
                self.abort()
            return
        self._send()

    def writelines(self, list_of_data: Iterable[bytes | bytearray | memoryview[Any]]) -> None:
        """Encrypt and send the joined data."""
        self.write(b"".join(list_of_data))

    def close(self) -> None:
        """Send the end in TLS, and close once everything is sent."""
        if self.is_closing():
            return
        # During a handshake there is nothing to end, and OpenSSL takes long to say so. It keeps a session only if the
        # end of its connection was sent.
        if self._is_secured and not is_full(self._tls.context):
            with suppress(ssl.SSLError):  # do not wait for its answer
                self._tls.unwrap()
            self._send()
        self._transport.close()

    def abort(self) -> None:
        """Close now, and drop unsent bytes."""
        self._transport.abort()

    @property
    def _is_held(self) -> bool:
        """Whether received bytes are not delivered at the moment."""
        return self._is_paused or self._is_blocked or self._has_peer_ended

    def _go_on(self) -> None:
        if self._is_held:
            return
        self._transport.resume_reading()
        asyncio.get_running_loop().call_soon(self._deliver)

    def _count(self, nbytes: int) -> None:
        """Move `nbytes` from the buffer to OpenSSL. They count as bytes beside data until data is decrypted."""
        self._incoming.write(_BUFFER[:nbytes])
        self._spare -= nbytes

    def _take_waiting(self, room: memoryview) -> int:
        """Decrypt waiting bytes while there is room. Return their number. `_deliver` handles an error."""
        taken = 0
        try:
            while taken < len(room) and (self._incoming.pending or self._tls.pending()):
                count = self._decrypt(room[taken:])  # one record: clients send each request in its own
                if not count:
                    break
                taken += count
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLError as error:
            self._wrong = self._wrong or explain(error)
        return taken

    def _decrypt(self, room: memoryview) -> int:
        """Decrypt into `room`. Return the number of bytes, 0 at the end in TLS. Raises ssl.SSLError."""
        count = cast("int", self._tls.read(len(room), cast("bytearray", room)))
        self._spare = min(self._spare + count * (1 + BESIDE_EACH_BYTE), MOST_BESIDE_DATA)
        return count

    def _deliver(self) -> None:
        """Decrypt received bytes into the application's own buffer."""
        application = self._application
        if application is None:
            return
        while not (self._is_held or self.is_closing()):
            room = application.get_buffer()
            if not len(room):  # not the end: the application processes its bytes first
                self._transport.pause_reading()
                asyncio.get_running_loop().call_soon(self._go_on)
                break
            try:
                count = self._decrypt(room)
            except ssl.SSLWantReadError:
                if self._spare < 0:
                    application.reject(TOO_MUCH_BESIDE_DATA)
                elif self._is_cut_off:
                    self._end()
                break
            except ssl.SSLError as error:
                application.reject(self._wrong or explain(error))  # with the alert that tells the client
                return
            if count == 0:
                self._end()
                break
            application.buffer_updated(count)
        self._send()

    def _end(self) -> None:
        """Tell the application, once, that the client sends no more; it still gets its responses."""
        if not self._has_peer_ended and self._application is not None:
            self._has_peer_ended = True
            self._transport.pause_reading()  # bytes behind the end in TLS would be kept and never used
            self._application.eof_received()

    def _send(self) -> None:
        if self._outgoing.pending:
            self._transport.write(self._outgoing.read())
