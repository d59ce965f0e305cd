"""What attacks on the web page cost a Modbus client, the gateway's memory, and an operator who wants to get in.

    .venv/bin/python tests/bench/page.py [--attack handshakes ...] [--rounds 5]

The attacks are handshakes (finished, left after the first message, sent byte by byte), changes of TLS's keys, clients
that say nothing, bodies in chunks of one byte, requests whose responses stay unread, and thousands of small ones.
Attackers have four addresses, and the lowest priority, as they are other machines in a plant. A plain Modbus client
asks every 2 ms, and an operator opens the page four times a second on connections of their own. Rounds of two kinds
take turns: with the attack at another gateway, which takes the same from the machine, and with it here. What counts is
the median of the ratios of the client's 99th percentiles; GOAL is its bound (status 1). PYTHONPATH chooses the gateway.
"""

import argparse
import os
import socket
import ssl
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[1]))

from gateway.modbus.mbap import encode
from kit.pki import pki
from kit.process import GatewayProcess

GOAL = 1.5
READ = encode(1, 200, bytes.fromhex("03 0000 000A"))
ROUND, PACE = 2.0, 0.002
#: What each attack is, and whether the page is https://.
ATTACKS = {
    "handshakes": True,
    "handshakes-left": True,
    "handshakes-in-bytes": True,
    "keys": True,
    "silent": False,
    "silent-tls": True,
    "chunks": False,
    "chunks-tls": True,
    "unread": False,
    "unread-tls": True,
    "many-requests": False,
}

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"
[[image]]
unit = 200
holding = 100
[web]
"""
SECURED = """
bind = "https://127.0.0.1:0"
certificate = "{pki}/server.crt"
key = "{pki}/server.key"
"""

ATTACKER = """
import os, socket, ssl, subprocess, sys, threading, time
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
os.nice(19)
port, ca, attack = int(sys.argv[1]), sys.argv[2], sys.argv[3]
context = ssl.create_default_context(cafile=ca)
context.check_hostname = False
is_secure = attack.endswith("-tls")
ASK = b"GET %s HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n"
CHUNKED = b"POST /login HTTP/1.1\\r\\nHost: localhost\\r\\nTransfer-Encoding: chunked\\r\\n\\r\\n"
CHUNKED += b"1\\r\\na\\r\\n" * 40000
UNREAD = ASK % b"/api/v1/openapi.json" * 400
MANY = ASK % b"/healthz" * 4000
done = 0
def connect(own):
    plain = socket.create_connection(("127.0.0.1", port), 5, (own, 0))
    return context.wrap_socket(plain) if is_secure else plain
def hello(plain, one_by_one):
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        context.wrap_bio(incoming, outgoing).do_handshake()
    except ssl.SSLWantReadError:
        pass
    plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    data = outgoing.read()
    for part in ([bytes((byte,)) for byte in data] if one_by_one else [data]):
        plain.send(part)
def flood(own, kept):
    global done
    while True:
        try:
            if attack == "keys":
                keys = subprocess.Popen(["openssl", "s_client", "-quiet", "-connect", f"127.0.0.1:{port}"],
                    stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                children.append(keys)
                while True:
                    keys.stdin.write(b"k\\n")
                    keys.stdin.flush()
                    done += 1
            if attack == "handshakes":
                plain = socket.create_connection(("127.0.0.1", port), 5, (own, 0))
                context.wrap_socket(plain).close()
            elif attack.startswith("handshakes"):
                plain = socket.create_connection(("127.0.0.1", port), 5, (own, 0))
                hello(plain, attack.endswith("bytes"))
                kept.append(plain)
            elif attack.startswith("silent"):
                kept.append(socket.create_connection(("127.0.0.1", port), 5, (own, 0)))
                time.sleep(0.005)
            else:
                client = connect(own)
                client.settimeout(1)
                kept.append(client)
                if attack.startswith("chunks"):  # all at once, of connections that have been served
                    client.sendall(ASK % b"/healthz")
                    client.recv(500)
                    time.sleep(0.5 - time.time() % 0.5)
                client.sendall({"c": CHUNKED, "u": UNREAD, "m": MANY}[attack[0]])
            done += 1
        except OSError:
            pass
        while len(kept) > most:
            kept.pop(0).close()
children = []
threads = 30 if attack[0] in "cum" else 2
most = {"s": 125, "h": 25, "c": 1}.get(attack[0], 4)
for own in range(2, 6):
    for _ in range(threads if attack != "keys" else 1):
        threading.Thread(target=flood, args=(f"127.0.0.{own}", []), daemon=True).start()
sys.stdin.read()
for child in children:
    child.kill()
print(done, flush=True)
os._exit(0)  # without waiting for the threads
"""

OPERATOR = """
import socket, ssl, sys, time
port, ca, is_secure = int(sys.argv[1]), sys.argv[2], sys.argv[3] == "True"
context = ssl.create_default_context(cafile=ca)
took, failed, end = [], 0, time.monotonic() + float(sys.argv[4])
while (began := time.monotonic()) < end:
    try:
        with socket.create_connection(("127.0.0.1", port), 3) as client:
            if is_secure:
                client = context.wrap_socket(client, server_hostname="localhost")
            client.sendall(b"GET /healthz HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n")
            if not client.recv(500).startswith(b"HTTP/1.1 200"):
                raise OSError
        took.append(time.monotonic() - began)
    except OSError:
        failed += 1
    time.sleep(max(0, began + 0.25 - time.monotonic()))
print(failed, *took)
"""


class Round(NamedTuple):
    """What a client and an operator saw, in seconds."""

    times: list[float]
    opened: list[float]
    failed: int

    @property
    def p99(self) -> float:
        return statistics.quantiles(self.times, n=100)[98]


def main() -> int:
    """Print a row for each attack; 1 if one is felt more than GOAL says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attack", choices=ATTACKS, nargs="*", default=list(ATTACKS))
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    print(f"load of the machine: {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors; {ssl.OPENSSL_VERSION}")
    print("plain client, ms: p99 elsewhere, here, ratio, max | operator, s: failed, median, max | MiB | attacks/s")
    return max([_measure(attack, args.rounds) for attack in args.attack])


def _measure(attack: str, rounds: int) -> int:
    is_secure = ATTACKS[attack]
    config = CONFIG + (SECURED.format(pki=pki()) if is_secure else 'bind = "http://127.0.0.1:0"\n')
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as elsewhere,
        GatewayProcess(Path(folder), config, level="info") as gateway,
        GatewayProcess(Path(elsewhere), config, level="info") as other,
    ):
        _round(gateway, is_secure=is_secure)
        before = gateway.memory()
        there, here, rates = [], [], []
        for _ in range(rounds):
            with _attack(other, attack):
                there.append(_round(gateway, is_secure=is_secure))
            with _attack(gateway, attack) as rate:
                here.append(_round(gateway, is_secure=is_secure))
            rates += rate
        more = gateway.memory(most=True) - before
    ratio = statistics.median(one.p99 / two.p99 for one, two in zip(here, there, strict=True))
    opened = [each for one in here for each in one.opened]
    failed = sum(one.failed for one in here)
    p99_there, p99_here = (statistics.median(one.p99 for one in each) * 1000 for each in (there, here))
    most = max(max(one.times) for one in here) * 1000
    client = f"{p99_there:8.2f} {p99_here:8.2f} {ratio:7.2f} {most:7.1f}"
    operator = (
        f"{failed:3} of {failed + len(opened):3} {statistics.median(opened or [0]):7.3f} {max(opened, default=0):7.3f}"
    )
    print(f"{attack:20} {client} | {operator} | {more / 1024:6.1f} | {statistics.mean(rates):8.0f}", flush=True)
    return int(ratio > GOAL)


@contextmanager
def _attack(gateway: GatewayProcess, attack: str) -> Iterator[list[float]]:
    rate: list[float] = []
    words = [sys.executable, "-c", ATTACKER, str(_page(gateway)), str(pki() / "ca.crt"), attack]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        began = time.monotonic()
        time.sleep(0.7)
        yield rate
        rate.append(int(process.communicate("")[0] or 0) / (time.monotonic() - began))
    time.sleep(0.3)


def _round(gateway: GatewayProcess, *, is_secure: bool) -> Round:
    words = [sys.executable, "-c", OPERATOR, str(_page(gateway)), str(pki() / "ca.crt"), str(is_secure), str(ROUND)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as operator:
        times = []
        with socket.create_connection(("127.0.0.1", gateway.port)) as client:
            end = time.monotonic() + ROUND
            while (began := time.monotonic()) < end:
                client.sendall(READ)
                client.recv(260)
                times.append(time.monotonic() - began)
                time.sleep(PACE)
        failed, *opened = operator.communicate()[0].split()
    return Round(times, [float(each) for each in opened], int(failed))


def _page(gateway: GatewayProcess) -> int:
    [address] = (event["address"] for event in gateway.log if event["event"] == "web_up")
    return int(address.rpartition(":")[2])


if __name__ == "__main__":
    sys.exit(main())
