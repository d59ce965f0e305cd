"""Look-ups of host names within a deadline, and detection of vanished peers."""

import asyncio
import socket
from functools import partial
from typing import Any

from gateway.clock.threads import ThreadPerCall

#: A result of `getaddrinfo`: family, type, protocol, canonical name, address.
AddressInfo = tuple[int, int, int, str, tuple[Any, ...]]
#: Host, port number, socket type.
_Query = tuple[str, int, socket.SocketKind]

#: Look-ups in progress, including abandoned ones, of each event loop.
_under_way: dict[tuple[asyncio.AbstractEventLoop, _Query], asyncio.Future[list[AddressInfo]]] = {}


async def look_up(host: str, port: int, kind: socket.SocketKind, deadline: float) -> list[AddressInfo]:
    """Look up the addresses of a host, within `deadline` seconds.

    Raises:
        OSError: the name is unknown, or no name server answers in time (`socket.EAI_AGAIN`).
        UnicodeError: the host name is invalid.
    """
    loop, query = asyncio.get_running_loop(), (host, port, kind)
    looking_up = _under_way.get((loop, query)) or _begin(loop, query)
    try:
        async with asyncio.timeout(deadline):
            return await asyncio.shield(looking_up)
    except TimeoutError as error:
        raise socket.gaierror(socket.EAI_AGAIN, "no name server answers") from error


def notice_vanished_peers(sock: socket.socket, *, idle: int, interval: int, probes: int, user_timeout: int) -> None:
    """Close the connection to a peer that is silent for `idle` seconds and then for all `probes`.

    The probes are `interval` seconds apart. A peer must acknowledge sent data within `user_timeout` milliseconds.
    Connections that a listening socket accepts inherit these options.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, idle)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, interval)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, probes)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, user_timeout)


def _begin(loop: asyncio.AbstractEventLoop, query: _Query) -> asyncio.Future[list[AddressInfo]]:
    """Look up in a new thread: a resolver that hangs cannot be stopped, and must not delay the end of the process."""
    thread = ThreadPerCall(f"look up {query[0]}")
    looking_up = loop.run_in_executor(thread, _addresses, query)
    for each, asked in list(_under_way):
        if each.is_closed():
            _under_way.pop((each, asked), None)  # another thread may do the same
    _under_way[loop, query] = looking_up
    looking_up.add_done_callback(partial(_done, loop, query))
    return looking_up


def _addresses(query: _Query) -> list[AddressInfo]:
    host, port, kind = query
    return [*socket.getaddrinfo(host, port, type=kind)]


def _done(loop: asyncio.AbstractEventLoop, query: _Query, looking_up: asyncio.Future[list[AddressInfo]]) -> None:
    del _under_way[loop, query]
    if not looking_up.cancelled():
        looking_up.exception()  # else asyncio logs it as an error that was never retrieved
