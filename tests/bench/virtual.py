"""Virtual units: what they save a SCADA that reads 20 meters, and what 10 000 mapped registers of 200 devices cost.

    .venv/bin/python tests/bench/virtual.py meters    one read of a virtual unit beside 20 reads one by one: a minute
    .venv/bin/python tests/bench/virtual.py size      registers of 200 devices on 32 lines, each a row of its own

The meters answer 20 ms after a request, on a paced line of 19200 baud. A SCADA reads them each second: six registers
of each, or all 120 in one block. For the size lines take no time, and each device is polled every second.
"""

import argparse
import json
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from statistics import quantiles
from struct import pack, unpack, unpack_from

import programs
from scenarios import Scenario
from used import cpu, resident

sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.process import COMMAND, GatewayProcess

METERS, REGISTERS = 20, 6
ANSWER_TIME = 0.020
#: The number of the virtual unit.
UNIT = 240

LINE = Scenario(what="", clients=4, baud=19200, units=f"1-{METERS}", timeout=5000)
HALL = Scenario(what="", clients=4, lines=32, units="1-7", timeout=5000)
DEVICES = 200
#: The most registers of a read.
MOST = 125


class Scada:
    """A client at this port that waits for each response, and checks all values: see wire.h."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), programs.PATIENCE)

    def read(self, unit: int, places: list[tuple[int, int]]) -> None:
        """Read the first holding registers of a unit, which have the values of these units and addresses."""
        self._socket.sendall(pack(">HHHBBHH", 1, 0, 6, unit, 3, 0, len(places)))
        head = self._socket.recv(9, socket.MSG_WAITALL)
        answered, function = unpack_from(">BB", head, 6)
        if (answered, function) != (unit, 3):
            raise programs.BenchError(f"an exception: {head.hex(' ')}")
        values = unpack(f">{len(places)}H", self._socket.recv(2 * len(places), socket.MSG_WAITALL))
        if [*values] != [(known_as * 2654435761 + address * 40503 + 0x1234) & 0xFFFF for known_as, address in places]:
            raise programs.BenchError(f"wrong values of unit {unit}")


@contextmanager
def gateway(scenario: Scenario, tools: Path, more_config: str, *words: str) -> Iterator[GatewayProcess]:
    """A gateway with simulated lines."""
    with tempfile.TemporaryDirectory(prefix="virtual.") as name:
        folder = Path(name)
        ttys = [folder / f"tty{number}" for number in range(scenario.lines)]
        command = [*programs.devices(scenario, tools, ttys), *words]
        simulator = programs.start(command, programs.processors()[0], stdout=subprocess.PIPE)
        try:
            programs.wait_for_ports(ttys, simulator)
            text = programs.config(scenario, folder, [*ttys], programs.free_port()).replace(
                '[log]\nformat = "json"\n', ""
            )
            with GatewayProcess(folder, text + more_config, level="info") as process:
                yield process
        finally:
            programs.end(simulator)


def block(rows: Iterator[tuple[str, int, int]]) -> str:
    """The config of a virtual unit with rows one behind the other: so many registers of a device, and from where."""
    at, text = 0, f'[[image]]\nunit = {UNIT}\nname = "hall"\nstale = "5 s"\nmap = [\n'
    for device, first, count in rows:
        text += f'  {{ at = {at}, device = "{device}", holding = "{first}-{first + count - 1}", every = "1 s" }},\n'
        at += count
    return text + "]\n"


def busy(process: GatewayProcess) -> float:
    """The seconds for which the first line was busy."""
    words = [*COMMAND, "status", "--json", "--control", str(process.config.parent / "control.sock")]
    told = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    return told["lines"][0]["busy_s"]


def meters(tools: Path, seconds: float) -> None:
    """Read 20 meters one after the other, and in one block; print how long each took, and the share of the line."""
    rows = ((f"line0-{unit}", 0, REGISTERS) for unit in range(1, METERS + 1))
    of = {unit: [(unit, address) for address in range(REGISTERS)] for unit in range(1, METERS + 1)}
    one_by_one = list(of.items())
    in_one = [(UNIT, [place for places in of.values() for place in places])]
    print("| a SCADA reads | p50 ms | p99 ms | longest | share of the line |\n|---|---:|---:|---:|---:|")
    for what, config, reads, pause in (
        ("20 meters, one after the other", "", one_by_one, 1.0),
        ("one virtual unit", block(rows), in_one, 0.05),
    ):
        with gateway(LINE, tools, config, "--delay", f"3:{ANSWER_TIME * 1e6:.0f}") as process:
            took = times(Scada(process.port), reads, 3.0, pause)
            before, since = busy(process), time.monotonic()
            took = times(Scada(process.port), reads, seconds, pause)
            share = (busy(process) - before) / (time.monotonic() - since)
        cuts = [1000 * cut for cut in quantiles(took, n=100, method="inclusive")]
        print(f"| {what} | {cuts[49]:.2f} | {cuts[98]:.2f} | {1000 * max(took):.2f} | {share:.1%} |", flush=True)


def times(scada: Scada, reads: list[tuple[int, list[tuple[int, int]]]], seconds: float, pause: float) -> list[float]:
    """How long all reads took, each time; they begin a `pause` apart."""
    took, until = [], time.monotonic() + seconds
    while (begun := time.monotonic()) < until:
        for unit, places in reads:
            scada.read(unit, places)
        took.append(time.monotonic() - begun)
        time.sleep(max(0.0, begun + pause - time.monotonic()))
    return took


def size(tools: Path, seconds: float, counts: list[int]) -> None:
    """Print what a map with so many rows of one register costs, and a gateway without one."""
    print("| rows | CPU | MiB | check, s of CPU | start | reload |\n|---|---:|---:|---:|---:|---:|")
    for count in counts:
        config = block(islice(registers(count), count)) if count else ""
        with gateway(HALL, tools, config) as process:
            start = cpu(process.pid, with_children=True)
            if count:
                read_once(process.port, count)
            time.sleep(5.0)
            before, since = cpu(process.pid), time.monotonic()
            time.sleep(seconds)
            share = (cpu(process.pid) - before) / (time.monotonic() - since)
            memory = resident(process.pid) / 1024
            before = cpu(process.pid, with_children=True)
            process.signal(signal.SIGHUP)
            process.wait_for("config_applied")
            reload = cpu(process.pid, with_children=True) - before
            check = cpu_of([*COMMAND, "check", str(process.config)])
        print(f"| {count} | {share:.1%} | {memory:.0f} | {check:.2f} | {start:.2f} | {reload:.2f} |", flush=True)


def registers(count: int) -> Iterator[tuple[str, int, int]]:
    """So many registers as rows, five of a device one behind the other, so that a read has those of many devices."""
    step = HALL.line_step
    devices = [f"line{line}-{step * line + unit}" for unit in range(1, 8) for line in range(HALL.lines)][:DEVICES]
    for first in range(0, count, 5):
        for device in devices:
            yield from ((device, first + more, 1) for more in range(5))


def read_once(port: int, count: int) -> None:
    """Read the first registers, and check them."""
    rows = islice(registers(count), min(count, MOST))
    Scada(port).read(UNIT, [(int(device.rpartition("-")[2]), first) for device, first, _ in rows])


def cpu_of(command: list[str]) -> float:
    """The seconds of CPU time that a command takes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure what is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", choices=["meters", "size"])
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--rows", type=int, nargs="+", default=[0, 1000, 10_000], help="size: the maps to measure")
    args = parser.parse_args()
    programs.compile_gateway()
    with tempfile.TemporaryDirectory() as name:
        programs.compile_into(Path(name))
        if args.what == "meters":
            meters(Path(name), args.seconds)
        else:
            size(Path(name), args.seconds, args.rows)


if __name__ == "__main__":
    main()
