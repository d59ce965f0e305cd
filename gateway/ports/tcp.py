"""A TCP connection as a port: to a device server with a serial line behind it, or to another Modbus TCP server."""

import asyncio
import errno
import os
import select
import socket
import ssl
from contextlib import suppress
from typing import Any, Final, cast

from gateway.clock.system_calls import read
from gateway.errors import ConnectionEnded, PortClosed, PortError
from gateway.hardware.ioctls import count_unsent
from gateway.ports.network import AddressInfo, look_up, notice_vanished_peers
from gateway.ports.port import CLOSED_AT_ONCE, Port, PortUser, TcpSettings
from gateway.tls.reasons import explain

#: How long it may take to look up the server's address, in seconds.
LOOKUP_DEADLINE: Final = 1.5
#: How long it may take to connect to that address, in seconds.
CONNECTING_DEADLINE: Final = 2.5
#: The longest pause after connecting, in seconds.
LONGEST_SETTLING: Final = 0.5
#: With TLS 1.3, a server may refuse our certificate after our side of the handshake, within this many seconds.
VERDICT_WITHIN: Final = 0.2
#: Far more than a line carries between two reads.
READ_SIZE: Final = 4096
#: The most bytes that wait for a server that takes none, beyond the system's buffers.
WRITE_BOUND: Final = 16 * 1024
#: How long a closed port may still send them, in seconds.
FLUSHING_DEADLINE: Final = 1.0
#: How long a server may take to confirm the end of TLS, in seconds. It need not, and the next connection waits for it.
CONFIRMING_DEADLINE: Final = 0.3
#: A vanished server is noticed within half a minute: seconds, seconds, number. While data is sent, `arrives_within`
#: counts.
KEEPALIVE: Final = {"idle": 10, "interval": 5, "probes": 3}

#: A server that closes a connection within this many seconds, without sending anything, closes it at once.
AT_ONCE: Final = 1.0
#: The error for one that does not answer when a connection is made.
NO_ANSWER: Final = "{port} does not answer: is it on, and does every firewall let us through?"
_NOT_SECURED: Final = "{port}: TLS failed: {reason}"
_NO_ROUTE: Final = "{port} cannot be reached: there is no route to it"
_NO_SUCH_NAME: Final = "{port}: unknown host name {host}"
_NO_NAME_SERVER: Final = "{port}: no name server answers, so {host} cannot be found"

_REASONS: Final = {
    errno.ECONNREFUSED: "{port} refuses the connection: does the server run, and is the port number right?",
    errno.ETIMEDOUT: NO_ANSWER,
    errno.EHOSTUNREACH: _NO_ROUTE,
    errno.ENETUNREACH: _NO_ROUTE,
    errno.EACCES: "{port}: this service may not connect to it",
    errno.EPERM: "{port}: this service may not connect to it, or a firewall of this machine forbids it",
    socket.EAI_NONAME: _NO_SUCH_NAME,
    socket.EAI_NODATA: _NO_SUCH_NAME,
    socket.EAI_AGAIN: _NO_NAME_SERVER,
}


async def open_tcp(settings: TcpSettings, user: PortUser, context: ssl.SSLContext | None = None) -> Port:
    """Connect to a server for `user`, with TLS if `context` is given. If cancelled, nothing stays open.

    Bytes that come within the latency of the connection (LONGEST_SETTLING at most) come before the port is used: a
    device server may still hold responses to requests of an earlier connection. So do those that come within
    `after_connect`.

    Raises:
        PortError: it cannot connect; the message says why and what to do.
    """
    try:
        addresses = await look_up(settings.host, settings.number, socket.SOCK_STREAM, LOOKUP_DEADLINE)
        async with asyncio.timeout(CONNECTING_DEADLINE):
            port = await _connect_to_any(settings, addresses, context)
    except (OSError, UnicodeError) as error:
        raise PortError(_explain_failure(settings, error)) from error
    try:
        await port.settle()
    except BaseException:
        port.close()
        raise
    port.begin(user)
    return port


class _NotSecuredError(PortError):
    """The server has refused our certificate, or we have refused its own."""


class TcpPort(asyncio.BufferedProtocol):
    """One connection as a port. `latency` in seconds."""

    is_virtual = True
    baud: int | None = None
    errors = None

    def __init__(self, settings: TcpSettings) -> None:
        self.latency = settings.latency
        self._after_connect = settings.after_connect
        self._is_secured = settings.tls is not None
        self._name = settings.port
        self._buffer = memoryview(bytearray(READ_SIZE))
        self._user: PortUser | None = None
        #: The last bytes received before there was a user; None if they are dropped.
        self._early = None if settings.drops_early else b""
        #: Since when received bytes are delivered, and whether there were any.
        self._began_at = 0.0
        self._has_heard = False
        #: Why the connection has ended, or will end; and whether we have ended it, so that nothing else matters.
        self._loss: PortError = PortClosed()
        self._is_left = False
        #: An unusable transport until the connection is made.
        self._transport = asyncio.Transport()
        self._descriptor = -1
        self._poll = select.poll()
        self._closed = asyncio.Event()

    async def settle(self) -> None:
        """Wait for the latency of the connection, and for `after_connect`. The server may close it meanwhile.

        Raises:
            PortError: the server has closed the connection again.
        """
        with suppress(TimeoutError):
            verdict_within = VERDICT_WITHIN if self._is_secured else 0.0
            async with asyncio.timeout(max(min(self.latency, LONGEST_SETTLING), verdict_within, self._after_connect)):
                await self._closed.wait()
        if self._closed.is_set():
            if isinstance(self._loss, _NotSecuredError):
                raise self._loss
            raise PortError(CLOSED_AT_ONCE.format(port=self._name))

    def begin(self, user: PortUser) -> None:
        """Deliver received bytes from now on, beginning with earlier ones."""
        loop = asyncio.get_running_loop()
        self._user = user
        self._began_at = loop.time()
        if self._early:
            loop.call_soon(self._deliver_early)

    def write(self, data: bytes) -> None:
        """Send `data` now; bytes that the system does not take at once follow later."""
        if self._transport.is_closing():
            return
        self._transport.write(data)
        if self._transport.get_write_buffer_size() > WRITE_BOUND:
            self._abort(PortError(f"{self._name} takes no more data"))

    def pause(self) -> bool:
        """Return False: a network does not deliver byte by byte."""
        return False

    def read_now(self) -> None:
        """Deliver received bytes, and notice a connection closed by the server before anything is written to it.

        What TLS has received cannot be read at once. It may be the end: the connection is given up. So nothing may be
        awaited on it.
        """
        if self._early:
            self._deliver_early()
        if self._transport.is_closing():
            return
        if self._is_secured:
            if self._poll.poll(0):
                self._abort(ConnectionEnded(f"{self._name} has closed the connection"))
                self._lose()
            return
        try:
            data = read(self._descriptor, READ_SIZE)
        except OSError as error:
            self._abort(self._explain_loss(error))
            return
        if data is None:
            return
        if data:
            self._deliver(data)
        else:
            self.eof_received()
            self._transport.close()
            self._lose()

    def change_baud(self, baud: int) -> None:
        """Lose the port: the rate of the line is a setting of the device server."""
        self._abort(PortError(f"{self._name}: the device server keeps its rate; set it to {baud} baud there"))

    def has_arrived(self) -> bool:
        """Tell whether the server has acknowledged every written byte."""
        if self._transport.get_write_buffer_size():
            return False
        return self._transport.is_closing() or count_unsent(self._descriptor) == 0

    def close(self) -> None:
        """Close once all written bytes are sent, or after FLUSHING_DEADLINE."""
        if self._transport.is_closing():
            return
        self._is_left = True
        self._transport.close()
        if self._transport.get_write_buffer_size():
            asyncio.get_running_loop().call_later(FLUSHING_DEADLINE, self._transport.abort)

    async def wait_closed(self) -> None:
        """Wait until the connection has ended."""
        await self._closed.wait()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the open connection."""
        self._transport = cast("asyncio.Transport", transport)
        self._descriptor = transport.get_extra_info("socket").fileno()
        self._poll.register(self._descriptor, select.POLLIN)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the longest frame decides
        """Return the buffer that asyncio receives into."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Deliver received bytes; keep the last of them while there is no user."""
        data = bytes(self._buffer[:nbytes])
        if self._user is not None:
            self._deliver(data)
        elif self._early is not None:
            self._early = (self._early + data)[-READ_SIZE:]

    def eof_received(self) -> None:
        """Note that the server has closed the connection, and whether it did so at once."""
        age = asyncio.get_running_loop().time() - self._began_at
        if self._has_heard or age > AT_ONCE:
            self._loss = ConnectionEnded(f"{self._name} has closed the connection")
        else:
            self._loss = ConnectionEnded(CLOSED_AT_ONCE.format(port=self._name), at_once=True)

    def connection_lost(self, exc: Exception | None) -> None:
        """Note why the connection has ended, and tell the user."""
        self._closed.set()
        if self._is_left:
            self._loss = PortClosed()
        elif self._is_secured and isinstance(exc, ssl.SSLError):
            self._loss = _NotSecuredError(_NOT_SECURED.format(port=self._name, reason=explain(exc)))
        elif isinstance(exc, OSError):
            self._loss = self._explain_loss(exc)
        self._lose()

    def _deliver(self, data: bytes) -> None:
        if self._user is not None and not self._is_left:
            self._has_heard = True
            self._user.received(data)

    def _deliver_early(self) -> None:
        early, self._early = self._early, None
        if early:
            self._deliver(early)

    def _lose(self) -> None:
        """Call the user's `lost`, once."""
        user, self._user = self._user, None
        if user is not None:
            user.lost(self._loss)

    def _explain_loss(self, error: OSError) -> PortError:
        return PortError(f"{self._name} is gone: {os.strerror(error.errno or errno.EIO).lower()}")

    def _abort(self, loss: PortError) -> None:
        self._loss = loss
        self._transport.abort()

    def __repr__(self) -> str:
        state = "closing" if self._transport.is_closing() else "open"
        return f"<TcpPort {self._name} {state}, {self._transport.get_write_buffer_size()} bytes to send>"


async def _connect_to_any(
    settings: TcpSettings, addresses: list[AddressInfo], context: ssl.SSLContext | None
) -> TcpPort:
    """Connect to the first of the server's addresses that accepts it."""
    for address in addresses[:-1]:
        with suppress(OSError):
            async with asyncio.timeout(CONNECTING_DEADLINE / len(addresses)):
                return await _connect(settings, address, context)
    return await _connect(settings, addresses[-1], context)


async def _connect(settings: TcpSettings, address: AddressInfo, context: ssl.SSLContext | None) -> TcpPort:
    """Connect with settings that send bytes at once and detect a vanished server."""
    family, kind, protocol, _, where = address
    securing: dict[str, Any] = {}
    if settings.tls is not None and context is not None:
        securing = {
            "ssl": context,
            "server_hostname": settings.tls.server_name,
            "ssl_handshake_timeout": CONNECTING_DEADLINE,
            "ssl_shutdown_timeout": CONFIRMING_DEADLINE,
        }
    sock = socket.socket(family, kind, protocol)
    try:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        notice_vanished_peers(sock, **KEEPALIVE, user_timeout=round(1000 * settings.arrives_within))
        loop = asyncio.get_running_loop()
        await loop.sock_connect(sock, where)
        _, port = await loop.create_connection(lambda: TcpPort(settings), sock=sock, **securing)
    except BaseException:
        sock.close()
        raise
    return port


def _explain_failure(settings: TcpSettings, error: OSError | UnicodeError) -> str:
    """Say why the server cannot be reached, and what to do."""
    if isinstance(error, UnicodeError):
        reason = _NO_SUCH_NAME
    elif settings.tls is not None and isinstance(error, ssl.SSLError):
        return _NOT_SECURED.format(port=settings.port, reason=explain(error))
    elif isinstance(error, TimeoutError):
        reason = NO_ANSWER
    else:
        reason = _REASONS.get(error.errno or 0, "{port} cannot be reached: {error}")
    return reason.format(port=settings.port, host=settings.host, error=getattr(error, "strerror", error))
