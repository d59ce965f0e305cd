"""One, ten and fifty gateways as processes, with a real nats-server: latency, messages at the hub, what each one costs.

    .venv/bin/python tests/bench/fleet.py [--gateways 1 10 50] [--seconds 10] [--real-time]

One more gateway asks all of them: by `fleet://`, and for comparison by `tcp://`. What they answer with is an image, so
what is measured is the way. First nothing is asked; then one client reads registers in turn, of the next gateway each
time, by both ways alternately; then 32 requests are under way at any time, by `fleet://`. `--real-time` lets all of it
go before everything else on a busy machine; that needs root.
"""

import argparse
import os
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from statistics import fmean, quantiles
from typing import NamedTuple

from used import cpu, go_first

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus import mbap
from kit.nats import NatsServer
from kit.process import GatewayProcess

READ = bytes((3, 0, 0, 0, 10))
#: Unit identifiers at the asking gateway: those of sites by NATS, and from FIRST_BY_TCP on by TCP.
FIRST_BY_TCP = 101
UNDER_WAY = 32
#: How many gateways start at once.
AT_ONCE = 4

OWNER = """
site = "plant-{number}"
[[listen]]
bind = "tcp://127.0.0.1:0"
[[image]]
unit = 1
holding = 100
[fleet]
servers = ["{server}"]
"""
ASKER = """
site = "control"
[[listen]]
bind = "tcp://127.0.0.1:0"
[fleet]
servers = ["{server}"]
"""
UPSTREAM = """
[[upstream]]
name = "{name}"
to = "{to}"
units = [{{ as = {unit}, unit = 1 }}]
"""


class Reading(NamedTuple):
    """What counts up: messages into and out of the server, seconds of CPU time of server, asker and owners."""

    at: float
    messages_in: int
    messages_out: int
    server: float
    asker: float
    owners: float


def memory(pid: int) -> float:
    """What of it is resident, in MiB, and what of that is its own and nobody else's."""
    rolled = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(rolled.split(f"{name}:")[1].split()[0]) for name in ("Private_Clean", "Private_Dirty")) / 1024


class Bench:
    """A server, so many gateways, and one that asks them."""

    def __init__(self, folder: Path, gateways: int, stack: ExitStack) -> None:
        self.server = stack.enter_context(NatsServer(folder))
        self.owners = [
            GatewayProcess(
                self._folder(folder, number), OWNER.format(number=number, server=self.server.url), level="info"
            )
            for number in range(1, gateways + 1)
        ]
        with ThreadPoolExecutor(AT_ONCE) as starting:
            list(starting.map(stack.enter_context, self.owners))
        for each in self.owners:
            each.wait_for("fleet_up")
        self.asker = stack.enter_context(GatewayProcess(self._folder(folder, 0), self._asking(), level="info"))
        self.by_fleet = range(1, gateways + 1)
        self.by_tcp = range(FIRST_BY_TCP, FIRST_BY_TCP + gateways)
        self.client = Client(self.asker.port)
        for unit in (*self.by_fleet, *self.by_tcp):
            self.client.ask_until_answered(unit)

    def _folder(self, folder: Path, number: int) -> Path:
        made = folder / f"gateway-{number}"
        made.mkdir()
        return made

    def _asking(self) -> str:
        text = ASKER.format(server=self.server.url)
        for number, owner in enumerate(self.owners, 1):
            ways = (number, f"fleet://plant-{number}"), (FIRST_BY_TCP - 1 + number, f"tcp://127.0.0.1:{owner.port}")
            text += "".join(UPSTREAM.format(name=f"way-{unit}", to=to, unit=unit) for unit, to in ways)
        return text

    def go_first(self) -> None:
        """All of its threads go before those of others."""
        go_first((os.getpid(), self.server.pid, self.asker.pid, *(each.pid for each in self.owners)))

    def read(self) -> Reading:
        """How everything stands."""
        told = self.server.told("varz")
        owners = sum(cpu(each.pid) for each in self.owners)
        at = time.monotonic()
        return Reading(at, told["in_msgs"], told["out_msgs"], cpu(self.server.pid), cpu(self.asker.pid), owners)

    def during(self, do: Callable[[], int]) -> "Figures":
        """What it took to do so many requests."""
        before, requests, after = self.read(), do(), self.read()
        return Figures(requests, *(late - early for early, late in zip(before, after, strict=True)))


class Figures(NamedTuple):
    """What was counted in a time: requests, and what a Reading has."""

    requests: int
    took: float
    messages_in: float
    messages_out: float
    server: float
    asker: float
    owners: float


class Client:
    """A Modbus TCP client."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._received = b""

    def ask(self, unit: int) -> float:
        """How long a read took, in seconds."""
        began = time.perf_counter()
        self.send(unit)
        pdu = self.receive()
        took = time.perf_counter() - began
        assert pdu[0] == READ[0], (unit, pdu)
        return took

    def ask_until_answered(self, unit: int) -> None:
        """The way is there when a read is answered."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            self.send(unit)
            pdu = self.receive()
            if pdu[0] == READ[0]:
                return
            time.sleep(0.1)
        raise TimeoutError(f"unit {unit} answers {pdu!r}")

    def send(self, unit: int) -> None:
        """A request."""
        self._socket.sendall(mbap.encode(unit, unit, READ))

    def receive(self) -> bytes:
        """The PDU of the next response."""
        while len(self._received) < 6 or len(self._received) < 6 + int.from_bytes(self._received[4:6]):
            data = self._socket.recv(65536)
            assert data, "the gateway has closed the connection"
            self._received += data
        end = 6 + int.from_bytes(self._received[4:6])
        pdu, self._received = self._received[7:end], self._received[end:]
        return pdu


def idle(seconds: float) -> int:
    """Ask nothing."""
    time.sleep(seconds)
    return 0


def alternately(bench: Bench, seconds: float, by_fleet: list[float], by_tcp: list[float]) -> int:
    """One request at a time, by one way and by the other."""
    ends_at = time.monotonic() + seconds
    while time.monotonic() < ends_at:
        for unit, other in zip(bench.by_fleet, bench.by_tcp, strict=True):
            by_fleet.append(bench.client.ask(unit))
            by_tcp.append(bench.client.ask(other))
    return len(by_fleet)


def many(bench: Bench, seconds: float) -> int:
    """So many requests under way at any time, each of the next gateway."""
    clients = [Client(bench.asker.port) for _ in range(4)]
    units = in_turn(bench.by_fleet)
    done, ends_at = 0, time.monotonic() + seconds
    for _ in range(UNDER_WAY // len(clients)):
        for each in clients:
            each.send(next(units))
    while time.monotonic() < ends_at:
        for each in clients:
            pdu = each.receive()
            assert pdu[0] == READ[0], pdu
            each.send(next(units))
            done += 1
    return done


def in_turn(units: range) -> Iterator[int]:
    while True:
        yield from units


def quantile(times: list[float], percent: int) -> float:
    """In milliseconds."""
    return 1000 * quantiles(times, n=100)[percent - 1]


def measure(folder: Path, gateways: int, seconds: float, *, real_time: bool) -> None:
    """Run it with so many gateways, and print."""
    with ExitStack() as stack:
        bench = Bench(folder, gateways, stack)
        if real_time:
            bench.go_first()
        quiet = bench.during(lambda: idle(seconds))
        fleet: list[float] = []
        tcp: list[float] = []
        bench.during(lambda: alternately(bench, seconds, fleet, tcp))
        busy = bench.during(lambda: many(bench, seconds))
        own = [memory(each.pid) for each in bench.owners]
        asker, server = memory(bench.asker.pid), bench.server.told("varz")["mem"] / 2**20
    print(f"{gateways} gateways and one that asks them")
    print(
        f"  one request at a time   fleet:// p50 {quantile(fleet, 50):.2f} ms, p99 {quantile(fleet, 99):.2f} ms;",
        end=" ",
    )
    print(f"tcp:// p50 {quantile(tcp, 50):.2f} ms, p99 {quantile(tcp, 99):.2f} ms ({len(tcp)} of each)")
    print(f"  {UNDER_WAY} at a time           {busy.requests / busy.took:.0f} requests a second;", end=" ")
    print(
        f"at the hub {busy.messages_in / busy.took:.0f} messages a second in, {busy.messages_out / busy.took:.0f} out"
    )
    cpus = {"hub": busy.server, "asker": busy.asker, "all owners": busy.owners}
    print(
        "    CPU for a request     "
        + ", ".join(f"{who} {1e6 * took / busy.requests:.0f} us" for who, took in cpus.items())
    )
    print(f"  idle, each gateway      {100 * quiet.owners / quiet.took / gateways:.2f} % of a core,", end=" ")
    print(f"{fmean(own):.0f} MiB of its own ({min(own):.0f} to {max(own):.0f})")
    print(f"    the one that asks     {100 * quiet.asker / quiet.took:.2f} % of a core, {asker:.0f} MiB")
    print(f"    the hub               {100 * quiet.server / quiet.took:.2f} % of a core, {server:.0f} MiB;", end=" ")
    print(
        f"messages a second: {quiet.messages_in / quiet.took:.1f} in, {quiet.messages_out / quiet.took:.1f} out",
        flush=True,
    )


def main() -> None:
    """Measure with each number of gateways."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--gateways", type=int, nargs="+", default=[1, 10, 50], metavar="N")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each of three parts")
    parser.add_argument("--real-time", action="store_true", help="go before everything else on this machine")
    args = parser.parse_args()
    for gateways in args.gateways:
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder), gateways, args.seconds, real_time=args.real_time)


if __name__ == "__main__":
    main()
