"""Clients that flood the gateway: connections from one address, each with requests always in flight.

Runs as a process of its own: python flood.py PORT CONNECTIONS IN_FLIGHT UNIT
"""

import asyncio
import itertools
import struct
import sys

#: The source address: each address has a share.
HOST = "127.0.0.9"
#: How many holding registers the polled unit has.
REGISTERS = 9000


class Greedy(asyncio.Protocol):
    """One connection. Each response triggers a request for other registers."""

    _addresses = itertools.count()

    def __init__(self, in_flight: int, unit: int) -> None:
        self._identifiers = itertools.count()  # of requests with the same one only the latest is answered
        self._in_flight = in_flight
        self._unit = unit
        self._unread = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        self._ask(self._in_flight)

    def data_received(self, data: bytes) -> None:
        self._unread += data
        answers = 0
        while len(self._unread) >= 6 and len(self._unread) >= (size := 6 + int.from_bytes(self._unread[4:6])):
            self._unread = self._unread[size:]
            answers += 1
        self._ask(answers)

    def _ask(self, times: int) -> None:
        self._transport.write(b"".join(self._request() for _ in range(times)))

    def _request(self) -> bytes:
        identifier, address = next(self._identifiers) & 0xFFFF, next(self._addresses) % REGISTERS
        return struct.pack(">HHHBBHH", identifier, 0, 6, self._unit, 3, address, 1)


async def flood(port: int, connections: int, in_flight: int, unit: int) -> None:
    """Never returns."""
    loop = asyncio.get_running_loop()
    for _ in range(connections):
        await loop.create_connection(lambda: Greedy(in_flight, unit), "127.0.0.1", port, local_addr=(HOST, 0))
    sys.stdout.write("all are connected\n")
    sys.stdout.flush()
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(flood(*map(int, sys.argv[1:])))
