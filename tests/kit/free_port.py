"""Port numbers that stay free until a test takes them.

The kernel gives out those from 32768 on, to the tests beside this one too. So these are others, and each process of
pytest on this machine has its own: as long as it runs it has taken their block, by a name that the kernel keeps.
"""

import socket
from collections.abc import Iterator
from functools import cache
from itertools import cycle
from typing import Final

_FIRST: Final = 20_000
_LAST: Final = 32_000
_EACH: Final = 200


def free_port() -> int:
    """A number that is free for TCP and for UDP, and is given to no other test."""
    while True:
        number = next(_numbers())
        with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
            try:
                tcp.bind(("0.0.0.0", number))
                udp.bind(("0.0.0.0", number))
            except OSError:
                continue
        return number


@cache
def _numbers() -> Iterator[int]:
    first, _ = _block()
    return cycle(range(first, first + _EACH))


@cache
def _block() -> tuple[int, socket.socket]:
    """The first number of a block, and what holds it."""
    for first in range(_FIRST, _LAST, _EACH):
        held = socket.socket(socket.AF_UNIX)
        try:
            held.bind(f"\0modbus-gateway tests from {first}")
        except OSError:
            held.close()
            continue
        return first, held
    raise RuntimeError("too many tests run at once")
