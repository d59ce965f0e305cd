"""A listener's sockets: bound to its address, with bounds on what they keep, and a way out of want of descriptors."""

import asyncio
import errno
import os
import socket
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from typing import Any, Final

from gateway.errors import ListenError
from gateway.listeners.session import ListenSettings

#: What the system may keep of a connection's bytes, each way: many requests, and no memory for clients to fill.
KERNEL_BUFFER: Final = 64 * 1024
#: Keep-alive (T 4.3.2): a peer that vanished is noticed after a minute. Seconds, seconds, probes.
KEEPALIVE_IDLE, KEEPALIVE_INTERVAL, KEEPALIVE_PROBES = 30, 10, 3
#: The same for a peer that vanished while something was sent to it, in milliseconds. It also ends the wait for the last
#: probe: the system's timers may be two seconds late each, and the minute is to hold.
USER_TIMEOUT: Final = 50_000
#: Connections that may wait to be accepted.
BACKLOG: Final = 1024

_ADVICE: Final = {
    errno.EACCES: "permission denied; ports below 1024 need root or CAP_NET_BIND_SERVICE",
    errno.EADDRINUSE: "another [[listen]] or another program has this port, perhaps another modbus-gateway",
    errno.EADDRNOTAVAIL: "this machine has no such address",
    errno.EMFILE: "no file descriptors are left; raise LimitNOFILE= of the service",
    errno.ENFILE: "the machine has no file descriptors left",
}
#: What is said of a port that another socket of ours has; without rights the system says EACCES of it.
_TAKEN: Final = (errno.EACCES, errno.EADDRINUSE)
_TAKEN_BY_US: Final = (
    "{} has this port, by modbus-gateway.socket (name that address, or change its ListenStream=) or by the config in"
    " force (restart)"
)
_EVERY_ADDRESS: Final = "::"
_IPV4_MAPPED: Final = "::ffff:"

#: What `getaddrinfo` gives: family, type, protocol, canonical name, address.
AddressInfo = tuple[int, int, int, str, tuple[Any, ...]]


class OpenSockets:
    """Sockets that are bound already: by systemd, which keeps clients waiting during a restart."""

    def __init__(self, sockets: Iterable[socket.socket] = ()) -> None:
        self.all = tuple(sockets)

    def take(self, kind: int, address: tuple[Any, ...]) -> socket.socket | None:
        """A copy of the socket at this address, if there is one; the original stays open."""
        for sock in self.all:
            if (sock.type, sock.getsockname()[:2]) == (kind, address[:2]):
                return sock.dup()
        return None

    def at(self, kind: int, port: int) -> list[str]:
        """The addresses of those with this port."""
        return [_address(sock) for sock in self.all if (sock.type, sock.getsockname()[1]) == (kind, port)]

    def without(self, doors: Iterable[socket.socket]) -> list[str]:
        """The addresses of those through which none of these `doors` leads: `tcp://0.0.0.0:502`."""
        used = {(door.type, door.getsockname()) for door in doors}
        return [_address(sock) for sock in self.all if (sock.type, sock.getsockname()) not in used]


async def doors(
    settings: ListenSettings, kind: socket.SocketKind, ready: OpenSockets | None = None
) -> list[socket.socket]:
    """A socket for each address of a listener, through which nobody can come yet. `::` takes IPv4 clients as well.

    Sockets that are `ready` are used instead of new ones.

    Raises:
        ListenError: an address is in use, needs more rights, or is none of this machine; nothing is left open.
    """
    loop = asyncio.get_running_loop()
    ready = ready or OpenSockets()
    try:
        found = await loop.getaddrinfo(settings.host, settings.port, type=kind, flags=socket.AI_PASSIVE)
        return _bound(found, ready, ipv6_only=settings.ipv6_only)
    except (OSError, UnicodeError) as error:
        raise cannot_listen(settings, error, ready.at(kind, settings.port)) from error


def door_address(settings: ListenSettings, bound: Sequence[socket.socket]) -> str:
    """What clients connect to, `tcp://127.0.0.1:5020`: the bound address, the configured one when there is none."""
    host, port = bound[0].getsockname()[:2] if bound else (settings.host, settings.port)
    return url(settings.scheme, host, port)


def cannot_listen(settings: ListenSettings, error: OSError | UnicodeError, ours: Sequence[str] = ()) -> ListenError:
    """Why nobody can connect to a listener, with its place in the config. `ours`: what we have open at its port."""
    place = f"{settings.source}: " if settings.source else ""
    is_taken = isinstance(error, OSError) and error.errno in _TAKEN
    reason = _TAKEN_BY_US.format(", ".join(ours)) if ours and is_taken else why(error)
    return ListenError(f"{place}cannot listen on {url(settings.scheme, settings.host, settings.port)}: {reason}")


def url(scheme: str, host: str, port: int) -> str:
    """A listener's address: `tcp://127.0.0.1:5020`."""
    return f"{scheme}://{written(host, port)}"


def plain(host: str) -> str:
    """A peer's address; that of an IPv4 client which came to an IPv6 socket as IPv4: `10.0.0.7`."""
    return host.removeprefix(_IPV4_MAPPED) if "." in host else host


def written(host: str, port: int) -> str:
    """An address as people write it: `10.0.0.7:502`, `[fe80::1]:502`."""
    host = plain(host)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def why(error: OSError | UnicodeError) -> str:
    """What an operator should know of `error`."""
    if isinstance(error, UnicodeError):
        return "this is no host name"
    if error.errno in _ADVICE:
        return _ADVICE[error.errno]
    if error.errno is not None and error.errno > 0:
        return os.strerror(error.errno).lower()
    return str(error.strerror).lower()  # a name that cannot be resolved: its number is none of the system's


class Reserve:
    """A descriptor kept back. When there are no others, it makes room to take a client and send it away at once.

    A client that is left waiting would keep the listening socket readable, and the event loop busy.
    """

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def hold(self) -> None:
        """Keep one back, if there is one."""
        if self._descriptor is None:
            with suppress(OSError):
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def release(self) -> None:
        """Keep none back."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def send_away(self, door: socket.socket) -> str | None:
        """Close the connection that waits first at `door`; who it was, or None when that could not be done."""
        self.release()
        try:
            client, address = door.accept()
            client.close()
        except OSError:
            return None
        finally:
            self.hold()
        return written(*address[:2])


def _address(sock: socket.socket) -> str:
    return url("udp" if sock.type == socket.SOCK_DGRAM else "tcp", *sock.getsockname()[:2])


def _bound(addresses: Iterable[AddressInfo], ready: OpenSockets, *, ipv6_only: bool) -> list[socket.socket]:
    with ExitStack() as on_error:
        sockets = []
        for family, kind, protocol, _, address in dict.fromkeys(addresses):
            sock = ready.take(kind, address)
            is_bound = sock is not None
            sock = on_error.enter_context(sock or socket.socket(family, kind, protocol))
            _set_options(sock)
            if not is_bound:
                _bind(sock, address, ipv6_only=ipv6_only)
            sockets.append(sock)
        on_error.pop_all()
    return sockets


def _bind(sock: socket.socket, address: tuple[Any, ...], *, ipv6_only: bool) -> None:
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, sock.type == socket.SOCK_STREAM)
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, ipv6_only or address[0] != _EVERY_ADDRESS)
    sock.bind(address)


def _set_options(sock: socket.socket) -> None:
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BUFFER)
    if sock.type == socket.SOCK_STREAM:
        _notice_vanished_peers(sock)


def _notice_vanished_peers(sock: socket.socket) -> None:
    """Accepted connections inherit it."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_IDLE)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, KEEPALIVE_INTERVAL)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, KEEPALIVE_PROBES)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, USER_TIMEOUT)
