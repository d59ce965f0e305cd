"""What bad clients do to a gateway, each in a process of its own.

An attack is a generator: it goes on for ever, and yields how often it has done its deed since it last did so.
"""

import os
import selectors
import shutil
import socket
import struct
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterator
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from typing import Final

Attack = Callable[[int], Iterator[int]]

#: The unit of an image with 125 holding registers; the other units that are asked for do not exist.
IMAGE: Final = 200
UNKNOWN_UNITS: Final = tuple(unit for unit in range(1, 248) if unit not in {1, IMAGE})
#: Connections that stop in the middle of a header.
HALF_OPEN: Final = 500
#: Where the flood of connections comes from: each address has a share of a listener's places.
ELSEWHERE: Final = "127.0.0.2"
#: Connections that the flood holds, at most; the gateway allows fewer.
HELD: Final = 1000
#: How long the gateway may take for anything, in seconds.
PATIENCE: Final = 10.0
#: Choose the client's port when it connects, so that a port that was just in use serves again (ip(7)).
IP_BIND_ADDRESS_NO_PORT: Final = 24
#: Requests in one piece, where requests come as fast as they are answered.
BURST: Final = 100


def read(unit: int, quantity: int) -> bytes:
    """A request for holding registers from address 0."""
    return bytes.fromhex("0001 0000 0006") + bytes((unit, 3, 0, 0)) + quantity.to_bytes(2)


#: A quantity of 0: answered with exception 03, nine bytes long as any exception.
MALFORMED: Final = read(1, 0)
EXCEPTION_SIZE: Final = 9


def attack(name: str, port: int, stop: Event, deeds: "Synchronized[int]") -> None:
    """Carry out an attack until `stop` is set. Whoever behaves goes first: what is measured is the gateway."""
    os.nice(19)
    for count in ATTACKS[name](port):
        deeds.value += count
        if stop.is_set():
            return


def half_open(port: int) -> Iterator[int]:
    """500 connections that send six bytes of a header, and come again when they are closed."""
    with selectors.DefaultSelector() as waiting:
        for _ in range(HALF_OPEN):
            waiting.register(_half_a_header(port), selectors.EVENT_READ)
            yield 1
        while True:
            for key, _ in waiting.select(0.1):
                waiting.unregister(key.fileobj)
                key.fileobj.close()
                waiting.register(_half_a_header(port), selectors.EVENT_READ)
                yield 1
            yield 0


def _half_a_header(port: int) -> socket.socket:
    client = connect(port)
    client.sendall(MALFORMED[:6])
    return client


def malformed(port: int) -> Iterator[int]:
    """100 malformed requests a second."""
    with connect(port) as client:
        while True:
            client.sendall(MALFORMED)
            receive(client, EXCEPTION_SIZE)
            yield 1
            time.sleep(0.01)


def malformed_flood(port: int) -> Iterator[int]:
    """Malformed requests as fast as they are answered."""
    with connect(port) as client:
        while True:
            client.sendall(MALFORMED * BURST)
            receive(client, EXCEPTION_SIZE * BURST)
            yield BURST


def unknown_units(port: int) -> Iterator[int]:
    """10 000 requests a second to units that do not exist."""
    requests = deque(read(unit, 1) for unit in UNKNOWN_UNITS)
    with connect(port) as client:
        due = time.monotonic()
        while True:
            client.sendall(b"".join(list(requests)[:BURST]))
            receive(client, EXCEPTION_SIZE * BURST)
            requests.rotate(-BURST)
            yield BURST
            due += BURST / 10_000
            time.sleep(max(0.0, due - time.monotonic()))


def slow_reader(port: int) -> Iterator[int]:
    """Asks for the largest answers as long as it is listened to, and reads none."""
    while True:
        client = connect(port)
        client.setblocking(False)
        try:
            while True:
                yield _push(client)
                time.sleep(0.01)
        except ConnectionError:
            client.close()


def _push(client: socket.socket) -> int:
    """Send requests that the gateway would take, whole or not; how many."""
    request = read(IMAGE, 125)
    try:
        return client.send(request * BURST) // len(request)
    except BlockingIOError:
        return 0


def connections(port: int) -> Iterator[int]:
    """One connection after the other; each is kept as long as the gateway keeps it."""
    held: deque[socket.socket] = deque()
    while True:
        held.append(connect(port, ELSEWHERE))
        if len(held) > HELD:
            held.popleft().close()
        yield 1


def resets(port: int) -> Iterator[int]:
    """Connections that are reset at once."""
    while True:
        client = connect(port)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
        yield 1


def port_scan(port: int) -> Iterator[int]:
    """nmap finds out what listens there, by asking in every language that it knows."""
    words = ["nmap", "-n", "-Pn", "-sT", "-sV", "-p", str(port), "127.0.0.1"]
    while True:
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        yield 1


def connect(port: int, source: str = "127.0.0.1") -> socket.socket:
    """A connection to the gateway, from the address `source`."""
    client = socket.socket()
    client.settimeout(PATIENCE)
    client.setsockopt(socket.IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, 1)
    client.bind((source, 0))
    client.connect(("127.0.0.1", port))
    return client


def receive(client: socket.socket, size: int) -> bytes:
    """So many bytes.

    Raises:
        ConnectionError: the gateway closed the connection before.
    """
    received = b""
    while len(received) < size:
        chunk = client.recv(size - len(received))
        if not chunk:
            raise ConnectionAbortedError("closed by the gateway")
        received += chunk
    return received


ATTACKS: Final[dict[str, Attack]] = {
    "half-open": half_open,
    "malformed": malformed,
    "malformed flood": malformed_flood,
    "unknown units": unknown_units,
    "slow reader": slow_reader,
    "connections": connections,
    "resets": resets,
}
if shutil.which("nmap"):
    ATTACKS["port scan"] = port_scan
