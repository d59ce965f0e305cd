"""Damaged TLS: handshakes and records of a good client, changed and cut at random.

    .venv/bin/python tests/soak/fuzz_tls.py --seconds 60

A gateway with a TLS listener gets them. It must not fail (`part_failed`, or a traceback), and a good client must be
served meanwhile. Ends with status 1 otherwise.
"""

import argparse
import random
import socket
import ssl
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus.mbap import encode
from kit.pki import OPERATOR, client_context, listener
from kit.process import PATIENCE, GatewayProcess

READ = encode(1, 200, bytes.fromhex("03 0000 0001"))


def main() -> int:
    """Fuzz for some seconds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=20)
    args = parser.parse_args()
    chance, counts = random.Random(args.seed), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        config = listener() + "[[image]]\nunit = 200\nholding = 10\n"
        with GatewayProcess(Path(folder), config, level="info") as gateway:
            end = time.monotonic() + args.seconds
            while time.monotonic() < end:
                counts[_damaged(gateway.port, chance)] += 1
                if not sum(counts.values()) % 100:
                    assert _served(gateway.port), "a good client is not served"
            assert _served(gateway.port)
            failed = [each for each in gateway.log if each["event"] == "part_failed"] + gateway.rest
    print(dict(counts))
    for each in failed:
        print(each)
    return int(bool(failed))


def _damaged(port: int, chance: random.Random) -> str:
    """One connection with something wrong in it; what became of it."""
    context = client_context(chance.choice([OPERATOR, ""]))
    if chance.random() < 0.5:
        context.maximum_version = ssl.TLSVersion.TLSv1_2
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    client = context.wrap_bio(incoming, outgoing, server_hostname="localhost")
    spoiled = chance.randrange(4)  # which of the client's flights
    with socket.create_connection(("127.0.0.1", port), PATIENCE, (f"127.0.0.{chance.randint(2, 250)}", 0)) as sock:
        sock.settimeout(0.5)
        with suppress(OSError):
            for flight in range(4):
                ready = _step(client)
                data = outgoing.read()
                sock.sendall(_spoil(data, chance) if flight == spoiled else data)
                if flight >= spoiled and chance.random() < 0.5:
                    return "left"
                incoming.write(sock.recv(65536))
                if ready and _answer(client) == b"\x03\x02":
                    return "answered before it was spoiled"
    return "closed"


def _step(client: ssl.SSLObject) -> bool:
    """Go on with the handshake; when it is done, send a request."""
    try:
        client.do_handshake()
        client.write(READ)
    except ssl.SSLError:
        return False
    return True


def _answer(client: ssl.SSLObject) -> bytes:
    try:
        return client.read(260)[7:9]
    except ssl.SSLError:
        return b""


def _spoil(data: bytes, chance: random.Random) -> bytes:
    spoiled = bytearray(data or b"\0")
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(spoiled))
        match chance.randrange(4):
            case 0:
                spoiled[at] = chance.randrange(256)
            case 1:
                del spoiled[at : at + chance.randint(1, 40)]
                spoiled = spoiled or bytearray(b"\0")
            case 2:
                spoiled[at:at] = chance.randbytes(chance.randint(1, 40))
            case _:
                spoiled += spoiled[at:]
    return bytes(spoiled)


def _served(port: int) -> bool:
    plain = socket.create_connection(("127.0.0.1", port), PATIENCE)
    with plain, client_context(OPERATOR).wrap_socket(plain, server_hostname="localhost") as client:
        client.sendall(READ)
        return client.recv(260)[7:9] == b"\x03\x02"


if __name__ == "__main__":
    sys.exit(main())
