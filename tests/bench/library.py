"""What a request costs in a program with a gateway.

    .venv/bin/python tests/bench/library.py calls      by the program, beside one that is only routed: ten seconds
    .venv/bin/python tests/bench/library.py units      to a unit made in Python, beside one to an image, by TCP clients
    .venv/bin/python tests/bench/library.py line       a line of 19200 baud, with asyncio's loop and the daemon's

`calls` is CPU time of one process, the least of several rounds in turns: other work only adds to it. Its line has no
kernel behind it, and is answered at once.
"""

import argparse
import asyncio
import logging
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import measure
import programs
from embedded import UNIT, Device, register
from scenarios import Scenario

from gateway import Gateway
from gateway.modbus import rtu
from gateway.request import Caller, Origin, Request

HERE = Path(__file__).parent
PROFILE = """
[profile.ten]
points = [{ name = "p-*", holding = "0-9" }]
"""
IMAGE = f"""
[[image]]
unit    = 200
profile = "ten"
holding = 1100
initial.holding = [{{ at = 0, values = {[register(200, at) for at in range(1100)]} }}]
[[image]]
unit    = {UNIT}
profile = "ten"
python  = "embedded:Device"
"""
ROUNDS, CALLS = 15, 300
WHAT = ("calls", "units", "line")
EMBEDDED: programs.Words = [sys.executable, HERE / "embedded.py"]


class AnsweredAtOnce:
    """The port of a line whose device answers each request as soon as the loop turns."""

    is_virtual = True
    has_arrived = None
    latency = 0.0
    errors = None

    def __init__(self, driver: Any) -> None:
        self._driver = driver
        self._answers = {count: rtu.encode(17, bytes((3, 2 * count)) + bytes(2 * count)) for count in range(1, 11)}
        driver.port_up(self)

    def write(self, data: bytes) -> None:
        """Take a request."""
        asyncio.get_running_loop().call_soon(self._driver.received, self._answers[data[5]])

    def pause(self) -> bool:
        """Hold nothing back."""
        return False

    def read_now(self) -> None:
        """Nothing stands unread."""


class Routed(Origin):
    """Requests with no more than an origin: what a program can do with what is not public."""

    def __init__(self, gateway: Any, unit: int) -> None:
        self.caller = Caller.without_address("embedded")
        self._router = gateway._operator.running.routers.embedded
        self._unit = unit
        self._loop = asyncio.get_running_loop()
        self._answered: asyncio.Future[bytes] | None = None

    def wants(self, _: Any) -> bool:
        """Everything."""
        return True

    def answer(self, _: Any, pdu: bytes) -> None:
        """Take the response."""
        self._answered.set_result(pdu)

    async def ask(self) -> bytes:
        """Read ten registers."""
        self._answered, now = self._loop.create_future(), self._loop.time()
        self._router.submit(Request(self._unit, b"\3\0\0\0\x0a", self, now), now)
        return await self._answered


async def calls() -> None:
    """Print what each way to ask costs."""
    listen = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
    line = '[[line]]\nname = "line"\nport = "/dev/none"\ngap = "0"\n'
    line += 'devices = [{ unit = 17, name = "device", profile = "ten" }]\n'
    logging.getLogger("gateway").setLevel(logging.ERROR)  # the line has no port
    async with Gateway.from_text(listen + line + IMAGE + PROFILE, units={UNIT: Device()}) as gateway:
        AnsweredAtOnce(gateway._operator.running.gateway.lines[0].driver)
        print("| of | routed only | request | read_holding of 10 | read a point | read ten points |")
        print("|---|---:|---:|---:|---:|---:|")
        for name, unit in (("an image", 200), ("a unit made in Python", UNIT), ("a line", 17)):
            client = gateway.unit(unit)
            ways: list[Callable[[], Awaitable[object]]] = [
                Routed(gateway, unit).ask,
                lambda client=client: client.request(b"\3\0\0\0\x0a"),
                lambda client=client: client.read_holding(0, 10),
                lambda client=client: client.read("p-1"),
                client.read_points,
            ]
            costs = await least(ways)
            print(f"| {name} | {' | '.join(f'{cost:.1f} us ({cost / costs[0]:.1f})' for cost in costs)} |", flush=True)


async def least(ways: list[Callable[[], Awaitable[object]]]) -> list[float]:
    """The microseconds of each way."""
    found = [float("inf")] * len(ways)
    for _ in range(ROUNDS):
        for number, way in enumerate(ways):
            began = time.process_time()
            for _ in range(CALLS):
                await way()
            found[number] = min(found[number], (time.process_time() - began) / CALLS * 1e6)
    return found


def units(folder: Path) -> None:
    """Print what TCP clients see of an image, and of a unit made in Python."""
    port, config = programs.free_port(), folder / "gateway.toml"
    config.write_text(f'[[listen]]\nbind = "tcp://127.0.0.1:{port}"\n{IMAGE}{PROFILE}')
    print("| of | clients | answers/s | p50 ms | p99 ms | CPU us |\n|---|---:|---:|---:|---:|---:|")
    with measure.running("embedded", [*EMBEDDED, config], programs.processors()[1], port, folder) as program:
        for clients in (1, 16):
            for name, unit in (("an image", 200), ("a unit made in Python", UNIT)):
                asked = Scenario(what="", clients=clients, units=str(unit))
                command = programs.load(asked, folder, port, program.pid)
                told = best([measure.asked(asked, command) for _ in range(3)])
                row = f"{told['rate']:.0f} | {told['p50']:.2f} | {told['p99']:.2f} | {told['cpu']:.0f}"
                print(f"| {name} | {clients} | {row} |", flush=True)


def line(folder: Path) -> None:
    """Print what clients see of a paced line."""
    scenario = Scenario(what="", clients=4, baud=19200, seconds=5)
    print("| the gateway | of line | p50 ms | p99 ms | CPU us |\n|---|---:|---:|---:|---:|")
    for name, program in (("as a daemon", programs.GATEWAY), ("in a program", EMBEDDED)):
        told = best([measure.run(scenario, folder, "gateway", program=program) for _ in range(3)])
        row = f"{told['of_line']:.3f} | {told['p50']:.1f} | {told['p99']:.1f} | {told['cpu']:.0f}"
        print(f"| {name} | {row} |", flush=True)


def best(runs: list[measure.Figures]) -> measure.Figures:
    """The run with the least CPU time; none may have a fault."""
    if any(run[fault] for run in runs for fault in measure.FAULTS if fault in run):
        raise programs.BenchError(f"wrong answers: {runs}")
    return min(runs, key=lambda run: run["cpu"])


def main() -> None:
    """Measure what is named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", choices=(*WHAT, []))
    what = parser.parse_args().what or WHAT
    if "calls" in what:
        asyncio.run(calls())
    with tempfile.TemporaryDirectory(prefix="library.") as name:
        programs.compile_into(Path(name))
        for each in (units, line):
            if each.__name__ in what:
                each(Path(name))


if __name__ == "__main__":
    main()
