"""A listener's sockets: bound to its address, with bounded buffers."""

import errno
import os
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Final

from gateway.errors import ListenError
from gateway.listeners.hosts import join_host_port, show_host, url
from gateway.listeners.settings import ListenSettings
from gateway.ports.network import AddressInfo, look_up, notice_vanished_peers

#: The kernel's buffer for each direction of a connection: enough for many requests, too small to exhaust memory.
KERNEL_BUFFER: Final = 64 * 1024
#: Keep-alive (T 4.3.2): a vanished peer is noticed after a minute. Seconds, seconds, number.
KEEPALIVE_IDLE, KEEPALIVE_INTERVAL, KEEPALIVE_PROBES = 30, 10, 3
#: The same for a peer that vanishes while data is sent to it, in milliseconds. It also limits the wait for the last
#: probe: each of the kernel's timers may be two seconds late, and the total must stay below a minute.
USER_TIMEOUT: Final = 50_000
#: The limit of looking up a listener's addresses, in seconds: the second name server is asked after 5 s.
LOOKUP_DEADLINE: Final = 15.0
#: The most connections that wait to be accepted.
BACKLOG: Final = 1024

_ADVICE: Final = {
    errno.EADDRINUSE: "another [[listen]] or another program has this port, perhaps another modbus-gateway",
    errno.EADDRNOTAVAIL: "this machine has no such address",
    errno.EMFILE: "no file descriptors are left; raise LimitNOFILE= of the service",
    errno.ENFILE: "the machine has no file descriptors left",
    socket.EAI_AGAIN: "no name server answers",
}
#: The errors for a port that needs more rights, and for one that belongs to a socket of systemd.
_NO_RIGHT: Final = (
    "permission denied; a port below 1024 needs root, CAP_NET_BIND_SERVICE, or a socket of systemd: "
    "give modbus-gateway.socket {}"
)
_TAKEN_BY_US: Final = "{} has this port, by modbus-gateway.socket: name that address, or change it there to {}"
_SHARED_WITH_US: Final = (
    "{} has this port, by modbus-gateway.socket: if several [[listen]] share a port, each must be named there: "
    "{key}= (empty), then a line for each address ([::] with BindIPv6Only=ipv6-only), such as {}"
)
_EVERY_ADDRESS: Final = "::"
_EVERY_IPV4_ADDRESS: Final = "0.0.0.0"  # noqa: S104 - nothing is bound by it here


class OpenSockets:
    """Sockets that are already bound by systemd, which keeps clients waiting during a restart.

    Also those of listeners that are `leaving`: they are reused, or give up their ports to others.
    """

    def __init__(self, sockets: Iterable[socket.socket] = (), leaving: Iterable[socket.socket] = ()) -> None:
        #: The sockets of systemd.
        self.all = tuple(sockets)
        self._leaving = tuple(leaving)
        #: Sockets of leaving listeners that have given up their ports.
        self._gave_way: list[socket.socket] = []

    def take(self, kind: int, address: tuple[Any, ...], *, ipv6_only: bool) -> socket.socket | None:
        """Duplicate the socket at this address, if there is one; the original stays open.

        For sockets of systemd, BindIPv6Only= decides whether they take IPv4 too.
        """
        leaving = (sock for sock in self._leaving if _is_ipv6_only(sock) == ipv6_only)
        for sock in (*self.all, *leaving):
            if (sock.type, sock.getsockname()[:2]) == (kind, address[:2]):
                return sock.dup()
        return None

    def take_wider(self, kind: int, address: tuple[Any, ...]) -> socket.socket | None:
        """Duplicate a socket of systemd that also receives clients of this address: see `is_meant`."""
        if kind == socket.SOCK_DGRAM and "%" in address[0]:  # a datagram does not tell the interface of its address
            return None
        for sock in self.all:
            if sock.type == kind and _covers(sock, address):
                return sock.dup()
        return None

    def bind(self, sock: socket.socket, address: tuple[Any, ...]) -> None:
        """Bind `sock`, and replace leaving sockets if necessary. Clients that still wait there are reset.

        Raises:
            OSError: see `socket.bind`.
        """
        try:
            sock.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            self._free_port(sock.type, address[1])
            with _allow_sharing(sock):
                sock.bind(address)

    def put_back(self) -> None:
        """Let the replaced sockets listen again, because their listeners stay. Close their replacements before."""
        for sock in self._gave_way:
            if sock.type == socket.SOCK_STREAM:
                sock.listen(BACKLOG)
            else:
                _set_sharing(sock, is_shared=False)

    def list_at(self, kind: int, port: int) -> list[str]:
        """Return the addresses of systemd's sockets with this port."""
        return [_show_address(sock) for sock in self.all if (sock.type, sock.getsockname()[1]) == (kind, port)]

    def list_unused(self, used: Iterable[socket.socket]) -> list[str]:
        """Return the addresses of systemd's sockets that are not `used`: `tcp://0.0.0.0:502`."""
        names = {(sock.type, sock.getsockname()) for sock in used}
        return [_show_address(sock) for sock in self.all if (sock.type, sock.getsockname()) not in names]

    def _free_port(self, kind: int, port: int) -> None:
        """Free the port: leaving sockets stop listening but stay bound. Sockets of systemd are left alone."""
        if self.list_at(kind, port):
            return
        for sock in self._leaving:
            if (sock.type, sock.getsockname()[1]) == (kind, port) and sock not in self._gave_way:
                self._gave_way.append(sock)
                if kind == socket.SOCK_STREAM:
                    sock.shutdown(socket.SHUT_RDWR)  # stop listening
                else:
                    _set_sharing(sock, is_shared=True)


async def find_addresses(settings: ListenSettings, kind: socket.SocketKind) -> list[AddressInfo]:
    """Look up the addresses of a listener.

    Raises:
        ListenError: its host has none, or no name server answers.
    """
    try:
        found = await look_up(settings.host, settings.port, kind, LOOKUP_DEADLINE)
    except (OSError, UnicodeError) as error:
        raise make_listen_error(settings, error) from error
    return list(dict.fromkeys(found))


def bind_sockets(
    settings: ListenSettings, addresses: Iterable[AddressInfo], ready: OpenSockets | None = None
) -> list[socket.socket]:
    """Bind a socket to each of a listener's addresses, without listening yet. `::` takes IPv4 clients too.

    Sockets that are `ready` are used instead of new ones. They may also receive clients of other listeners: see
    `is_meant`.

    Raises:
        ListenError: an address is in use, needs more rights, or does not belong to this machine; nothing is left open.
    """
    ready = ready or OpenSockets()
    try:
        return _bind_all(addresses, ready, settings)
    except OSError as error:
        raise make_listen_error(settings, error, ready) from error


def is_meant(asked: str, bound: socket.socket, addresses: Iterable[AddressInfo]) -> bool:
    """Tell whether a client of the host `asked` is for one of `addresses`: a wider `bound` socket receives others."""
    ours = {address[0] for *_, address in addresses}
    if bound.getsockname()[0] in ours:
        return True
    asked = show_host(asked)
    return asked in ours or (_EVERY_IPV4_ADDRESS in ours and ":" not in asked)


def overlap(one: socket.socket, other: socket.socket) -> bool:
    """Tell whether two bound sockets have a port and an address in common: only one of them can listen."""
    mine, others = one.getsockname(), other.getsockname()
    return one.type == other.type and (mine[:2] == others[:2] or _covers(one, others) or _covers(other, mine))


def show_bound_address(settings: ListenSettings, bound: Sequence[socket.socket]) -> str:
    """Format the bound address, else the configured one: `tcp://127.0.0.1:5020`."""
    host, port = bound[0].getsockname()[:2] if bound else (settings.host, settings.port)
    if host in {_EVERY_ADDRESS, _EVERY_IPV4_ADDRESS}:  # perhaps of a wider socket
        host = settings.host
    return url(settings.scheme, host, port)


def make_listen_error(
    settings: ListenSettings, error: OSError | UnicodeError, ready: OpenSockets | None = None
) -> ListenError:
    """Make the error with the reason why a listener cannot listen. `ready` as in `bind_sockets`."""
    place = f"{settings.source}: " if settings.source else ""
    reason = _advise_on_systemd(settings, error, ready or OpenSockets()) or explain(error)
    return ListenError(f"{place}cannot listen on {url(settings.scheme, settings.host, settings.port)}: {reason}")


def explain(error: OSError | UnicodeError) -> str:
    """Describe `error` for an operator."""
    if isinstance(error, UnicodeError):
        return "this is not a valid host name"
    if error.errno in _ADVICE:
        return _ADVICE[error.errno]
    if error.errno is not None and error.errno > 0:
        return os.strerror(error.errno).lower()
    return str(error.strerror).lower()  # a name that cannot be resolved has no errno


def _advise_on_systemd(settings: ListenSettings, error: OSError | UnicodeError, ready: OpenSockets) -> str:
    """Return what to change in modbus-gateway.socket; empty if that does not help.

    Without rights, a port that is in use also fails with EACCES.
    """
    if not isinstance(error, OSError) or error.errno not in {errno.EACCES, errno.EADDRINUSE}:
        return ""
    is_udp = settings.scheme == "udp"
    key = "ListenDatagram" if is_udp else "ListenStream"
    wanted = f"{key}={join_host_port(settings.host, settings.port)}, then systemctl restart modbus-gateway.socket"
    if ours := ready.list_at(socket.SOCK_DGRAM if is_udp else socket.SOCK_STREAM, settings.port):
        taken = _SHARED_WITH_US if settings.shares_port else _TAKEN_BY_US
        return taken.format(", ".join(ours), wanted, key=key)
    return _NO_RIGHT.format(wanted) if error.errno == errno.EACCES else ""


def _show_address(sock: socket.socket) -> str:
    return url("udp" if sock.type == socket.SOCK_DGRAM else "tcp", *sock.getsockname()[:2])


def _bind_all(addresses: Iterable[AddressInfo], ready: OpenSockets, settings: ListenSettings) -> list[socket.socket]:
    with ExitStack() as on_error:
        sockets = []
        for family, kind, protocol, _, address in addresses:
            without_ipv4 = family == socket.AF_INET6 and (settings.ipv6_only or address[0] != _EVERY_ADDRESS)
            taken = ready.take(kind, address, ipv6_only=without_ipv4)
            if taken is None and not settings.shares_port:
                taken = ready.take_wider(kind, address)
            sock = on_error.enter_context(taken or socket.socket(family, kind, protocol))
            _set_options(sock)
            if taken is None:
                _set_scope(sock, ipv6_only=without_ipv4)
                ready.bind(sock, address)
            sockets.append(sock)
        on_error.pop_all()
    return sockets


def _set_scope(sock: socket.socket, *, ipv6_only: bool) -> None:
    """Allow reuse of the port after closed connections, and set whether IPv4 is included."""
    _set_sharing(sock, is_shared=sock.type == socket.SOCK_STREAM)
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, ipv6_only)


def _is_ipv6_only(sock: socket.socket) -> bool:
    return sock.family == socket.AF_INET6 and bool(sock.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY))


def _covers(sock: socket.socket, address: tuple[Any, ...]) -> bool:
    """Tell whether `sock` is bound to the wildcard address that includes `address`."""
    host, port = sock.getsockname()[:2]
    is_ipv6 = ":" in address[0]
    every = host == _EVERY_ADDRESS if is_ipv6 or sock.family == socket.AF_INET6 else host == _EVERY_IPV4_ADDRESS
    return port == address[1] and every and (is_ipv6 or not _is_ipv6_only(sock))


@contextmanager
def _allow_sharing(sock: socket.socket) -> Iterator[None]:
    """Allow `sock` to be bound to a port that others share, in this context; restore its own setting afterwards."""
    is_shared = sock.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)
    _set_sharing(sock, is_shared=True)
    yield
    _set_sharing(sock, is_shared=bool(is_shared))


def _set_sharing(sock: socket.socket, *, is_shared: bool) -> None:
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, is_shared)


def _set_options(sock: socket.socket) -> None:
    sock.setblocking(False)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BUFFER)
    if sock.type == socket.SOCK_STREAM:
        notice_vanished_peers(
            sock,
            idle=KEEPALIVE_IDLE,
            interval=KEEPALIVE_INTERVAL,
            probes=KEEPALIVE_PROBES,
            user_timeout=USER_TIMEOUT,
        )
