"""What TLS costs: memory of a connection, handshakes a second, processor time of a transaction, and others' patience.

    .venv/bin/python tests/bench/tls.py [--connections 1000] [--flood finished|half-open|byte-by-byte]

`--flood`: a plain client asks every 2 ms, while another process begins handshakes as fast as it can from 4 addresses:
all are finished, with a good certificate, or half of them are left open, or each byte is sent alone. The flood has the
lowest priority, as it comes from other machines in a plant. Rounds of three kinds take turns: without it, with it at
another gateway, which takes the same from the machine, and with it here. What counts is the 99th percentile of the
third over that of the second, the median of all rounds; GOAL is its bound (status 1). Other work on the machine is
felt: the load is printed. `chrt -r 5` keeps it away.
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
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from used import resident

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus.mbap import encode
from kit.pki import OPERATOR, client_context, listener, pki
from kit.process import GatewayProcess

GOAL = 1.5
READ = encode(1, 200, bytes.fromhex("03 0000 000A"))
ANSWER = 29
ROUNDS, ROUND, PACE = 7, 2.0, 0.002
#: What the handshakes of a flood become.
FLOODS = {"half-open": "finished unfinished", "finished": "finished", "byte-by-byte": "dribbled"}
TICKS = os.sysconf("SC_CLK_TCK")

FLOOD = """
import os, socket, ssl, sys, threading, time
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
os.nice(19)
port, cert, kinds = int(sys.argv[1]), sys.argv[2], sys.argv[3].split()
context = ssl.create_default_context(cafile=f"{cert}/ca.crt")
context.check_hostname = False
context.load_cert_chain(f"{cert}/operator.crt", f"{cert}/operator.key")
done, began = 0, time.monotonic()
def dribble(plain):
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        context.wrap_bio(incoming, outgoing).do_handshake()
    except ssl.SSLWantReadError:
        pass
    plain.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in outgoing.read():
        plain.send(bytes((byte,)))
def flood(own, kind):
    global done
    kept = []
    while True:
        try:
            plain = socket.create_connection(("127.0.0.1", port), 5, (own, 0))
            if kind == "dribbled":
                dribble(plain)
            elif kind == "finished":
                context.wrap_socket(plain).close()
                done += 1
            else:
                kept.append(plain)
                if len(kept) > 50:
                    kept.pop(0).close()
        except OSError:
            pass
for own in range(2, 6):
    for kind in kinds:
        threading.Thread(target=flood, args=(f"127.0.0.{own}", kind), daemon=True).start()
sys.stdin.read()
print(done / (time.monotonic() - began))
"""


def main() -> int:
    """Print each figure; 1 if a flood is felt more than GOAL says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--connections", type=int, default=1000, help="for the memory of each")
    parser.add_argument("--flood", choices=FLOODS, help="measure beside such a flood, and nothing else")
    args = parser.parse_args()
    image = "[[image]]\nunit = 200\nholding = 100\n"
    plain = f'[[listen]]\nname = "plain"\nbind = "tcp://127.0.0.1:0"\nclients = {args.connections + 10}\n'
    tls = listener(f"clients = {args.connections + 10}")
    print(f"load of the machine: {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors; {ssl.OPENSSL_VERSION}")
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as elsewhere,
        GatewayProcess(Path(folder), plain + tls + image, level="info") as gateway,
        GatewayProcess(Path(elsewhere), plain + tls + image, level="info") as other,
    ):
        ports = gateway.ports["tcp"], gateway.ports["tls"]
        context = client_context(OPERATOR)
        if not args.flood:
            _handshakes(gateway, ports[1], context)
            _transactions(gateway, ports, context)
            _memory(gateway, ports, context, args.connections)
        return max([_patience(gateway, other, flood) for flood in ([args.flood] if args.flood else FLOODS)])


def _handshakes(gateway: GatewayProcess, port: int, context: ssl.SSLContext) -> None:
    def once(_: int) -> None:
        _connect(port, context).close()

    for name, resumed in (("new", False), ("resumed", True)):
        session = None
        before, began = _processor_time(gateway), time.monotonic()
        before_in_loop = _processor_time(gateway, gateway.pid)
        for _ in range(300):
            client = _connect(port, context, session)
            client.sendall(READ)
            client.recv(260)
            session = client.session if resumed else None
            client.close()
        took, used = time.monotonic() - began, _processor_time(gateway) - before
        in_loop = _processor_time(gateway, gateway.pid) - before_in_loop
        print(
            f"handshakes, {name}: {300 / took:.0f}/s in a row; each {used / 300 * 1000:.2f} ms of the gateway, "
            f"{in_loop / 300 * 1000:.2f} ms in its event loop"
        )
    with ThreadPoolExecutor(4) as pool:
        began = time.monotonic()
        list(pool.map(once, range(400)))
    print(f"handshakes, four at a time: {400 / (time.monotonic() - began):.0f}/s")


def _transactions(gateway: GatewayProcess, ports: tuple[int, int], context: ssl.SSLContext) -> None:
    costs = []
    clients = [socket.create_connection(("127.0.0.1", ports[0])), _connect(ports[1], context)]
    for client in clients:
        best = []
        for _ in range(5):
            before, count = _processor_time(gateway), 4000
            for _ in range(count):
                client.sendall(READ)
                client.recv(260)
            best.append((_processor_time(gateway) - before) / count * 1e6)
        costs.append(min(best))
        client.close()
    print(f"a transaction: {costs[0]:.0f} us plain, {costs[1]:.0f} us over TLS: {costs[1] / costs[0]:.2f} times")


def _memory(gateway: GatewayProcess, ports: tuple[int, int], context: ssl.SSLContext, count: int) -> None:
    for name, connect in (
        ("plain", lambda: socket.create_connection(("127.0.0.1", ports[0]))),
        ("TLS", lambda: _connect(ports[1], context)),
    ):
        before = resident(gateway.pid)
        clients = []
        for _ in range(count):
            client = connect()
            client.sendall(READ)
            client.recv(260)
            clients.append(client)
        time.sleep(1.0)
        after = resident(gateway.pid)
        print(f"{count} {name} connections: {(after - before) / count:.1f} KiB each, {after / 1024:.0f} MiB in all")
        for client in clients:
            client.close()
        time.sleep(2.0)


def _patience(gateway: GatewayProcess, other: GatewayProcess, flood: str) -> int:
    percentiles: list[tuple[float, float, float]] = []
    rates: list[float] = []
    for _ in range(ROUNDS):
        quiet = _percentile(gateway)
        with _flood(other.ports["tls"], FLOODS[flood]):
            elsewhere = _percentile(gateway)
        with _flood(gateway.ports["tls"], FLOODS[flood]) as rate:
            here = _percentile(gateway)
        percentiles.append((quiet, elsewhere, here))
        rates += rate
    ratios = sorted(here / elsewhere for _, elsewhere, here in percentiles)
    alone, beside, under = (statistics.median(each) * 1000 for each in zip(*percentiles, strict=True))
    print(
        f"a flood of handshakes, {flood}; p99 of a plain client: {alone:.2f} ms without; "
        f"{beside:.2f} ms with the flood at another gateway, {under:.2f} ms with it here"
    )
    print(
        f"  that is {statistics.median(ratios):.2f} times, from {ratios[0]:.2f} to {ratios[-1]:.2f}; "
        f"{statistics.mean(rates):.0f} handshakes/s were done"
    )
    return int(statistics.median(ratios) > GOAL)


@contextmanager
def _flood(port: int, kinds: str) -> Iterator[list[float]]:
    """Yields a list that has the handshakes done in each second when the flood is over."""
    result: list[float] = []
    words = [sys.executable, "-c", FLOOD, str(port), str(pki()), kinds]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        time.sleep(0.7)
        yield result
        result.append(float(process.communicate("")[0]))
    time.sleep(0.3)


def _percentile(gateway: GatewayProcess) -> float:
    """The 99th percentile of a plain client's response times."""
    times = []
    with socket.create_connection(("127.0.0.1", gateway.ports["tcp"])) as client:
        own = f"127.0.0.1:{client.getsockname()[1]}"
        end = time.monotonic() + ROUND
        while (began := time.monotonic()) < end:
            client.sendall(READ)
            if len(client.recv(260)) != ANSWER:
                raise RuntimeError(f"{own} was closed: {[each for each in gateway.log if each.get('client') == own]}")
            times.append(time.monotonic() - began)
            time.sleep(PACE)
    return statistics.quantiles(times, n=100)[98]


def _connect(port: int, context: ssl.SSLContext, session: ssl.SSLSession | None = None) -> ssl.SSLSocket:
    plain = socket.create_connection(("127.0.0.1", port))
    return context.wrap_socket(plain, server_hostname="localhost", session=session)


def _processor_time(gateway: GatewayProcess, thread: int = 0) -> float:
    """Of the process, or of one of its threads, in seconds."""
    task = f"task/{thread}/" if thread else ""
    fields = Path(f"/proc/{gateway.pid}/{task}stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


if __name__ == "__main__":
    sys.exit(main())
