"""The addresses of a host. A name server may take for ever to answer; whoever asks here waits only so long."""

import asyncio
import socket
from functools import partial
from typing import Any

from gateway.ports.threads import ThreadPerCall

#: What `getaddrinfo` gives: family, type, protocol, canonical name, address.
AddressInfo = tuple[int, int, int, str, tuple[Any, ...]]
#: What is looked up: host, port number, kind of socket.
_Question = tuple[str, int, socket.SocketKind]

#: What name servers are being asked for, also when nobody waits for it any more.
_under_way: dict[_Question, asyncio.Future[list[AddressInfo]]] = {}


async def look_up(host: str, port: int, kind: socket.SocketKind, deadline: float) -> list[AddressInfo]:
    """The addresses of a host, which may take `deadline` seconds.

    Raises:
        OSError: nobody knows the name, or no name server answers within that (`socket.EAI_AGAIN`).
        UnicodeError: this is not a valid host name.
    """
    question = (host, port, kind)
    looking_up = _under_way.get(question) or _begin(question)
    try:
        async with asyncio.timeout(deadline):
            return await asyncio.shield(looking_up)
    except TimeoutError as error:
        raise socket.gaierror(socket.EAI_AGAIN, "no name server answers") from error


def _begin(question: _Question) -> asyncio.Future[list[AddressInfo]]:
    """Ask in a thread of its own: nothing can stop a resolver that hangs, and the end of the process must not wait."""
    thread = ThreadPerCall(f"look up {question[0]}")
    looking_up = asyncio.get_running_loop().run_in_executor(thread, _addresses, question)
    _under_way[question] = looking_up
    looking_up.add_done_callback(partial(_done, question))
    return looking_up


def _addresses(question: _Question) -> list[AddressInfo]:
    host, port, kind = question
    return [*socket.getaddrinfo(host, port, type=kind)]


def _done(question: _Question, looking_up: asyncio.Future[list[AddressInfo]]) -> None:
    del _under_way[question]
    if not looking_up.cancelled():
        looking_up.exception()  # asyncio complains of errors that nobody has looked at
