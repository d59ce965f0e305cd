"""Port numbers that stay free until a test takes them.

The kernel gives out those from 32768 on, to the tests beside this one too. So these are others, and each worker of
pytest has its own.
"""

import os
import socket
from itertools import count
from typing import Final

_FIRST: Final = 20_000
_EACH: Final = 1_000
_WORKER: Final = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_NUMBERS: Final = count(_FIRST + _EACH * _WORKER)


def free_port() -> int:
    """A number that is free for TCP and for UDP, and is not given to another test of this run."""
    while True:
        number = next(_NUMBERS)
        with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
            try:
                tcp.bind(("0.0.0.0", number))
                udp.bind(("0.0.0.0", number))
            except OSError:
                continue
        return number
