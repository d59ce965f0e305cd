"""A listener's sockets: bound to its address, with bounds on what they keep, and a way out of want of descriptors."""

import errno
import os
import socket
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from typing import Any, Final

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
_EVERY_ADDRESS: Final = "::"
_IPV4_MAPPED: Final = "::ffff:"

#: What `getaddrinfo` gives: family, type, protocol, canonical name, address.
AddressInfo = tuple[int, int, int, str, tuple[Any, ...]]


def bound(addresses: Iterable[AddressInfo]) -> list[socket.socket]:
    """A socket for each of the addresses, which nobody can connect to yet. `::` takes IPv4 clients as well.

    Raises:
        OSError: one of them cannot be used; nothing is left open.
    """
    with ExitStack() as on_error:
        sockets = [on_error.enter_context(_socket(*address)) for address in dict.fromkeys(addresses)]
        on_error.pop_all()
    return sockets


def written(host: str, port: int) -> str:
    """An address as people write it: `10.0.0.7:502`, `[fe80::1]:502`; IPv4 that came to an IPv6 socket as IPv4."""
    host = host.removeprefix(_IPV4_MAPPED) if "." in host else host
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


def _socket(family: int, kind: int, protocol: int, _name: str, address: tuple[Any, ...]) -> socket.socket:
    with ExitStack() as on_error:
        sock = on_error.enter_context(socket.socket(family, kind, protocol))
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, address[0] != _EVERY_ADDRESS)
        _set_options(sock)
        sock.bind(address)
        on_error.pop_all()
    return sock


def _set_options(sock: socket.socket) -> None:
    """Notice peers that vanish, and keep little of those that do not listen. Accepted connections inherit all of it."""
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_IDLE)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, KEEPALIVE_INTERVAL)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, KEEPALIVE_PROBES)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, USER_TIMEOUT)
