"""A gateway beside an aiohttp server in one program: what HTTP and Modbus clients see, alone and together. A minute.

    .venv/bin/python tests/bench/beside.py

A line of 19200 baud and four clients. `paced` is 200 requests of HTTP a second; `as many as it can` is what eight
connections ask, each one request after the other. The last column is the whole program's share of a core.
"""

import asyncio
import json
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import measure
import programs
from scenarios import Scenario

from library import asking, best, started


class Loads(NamedTuple):
    """What a program is asked for: Modbus, and HTTP with this pause between two requests of a connection, if any."""

    name: str
    has_modbus: bool
    pause: float | None = None


LOADS = (
    Loads("the gateway alone", has_modbus=True),
    Loads("the server alone, paced", has_modbus=False, pause=0.04),
    Loads("both, paced", has_modbus=True, pause=0.04),
    Loads("the server alone, as many as it can", has_modbus=False, pause=0.0),
    Loads("both, as many as it can", has_modbus=True, pause=0.0),
)


def beside(folder: Path) -> None:
    """Print what HTTP and Modbus clients see, alone and together."""
    print("| | HTTP/s | p50 ms | p99 ms | of line | p50 ms | p99 ms | of a core |\n|---|" + "---:|" * 7)
    scenario = Scenario(what="", clients=4, baud=19200, seconds=5)
    daemon = best([measure.run(scenario, folder, "gateway")])
    print(f"| the gateway as a process of its own | | | | {of_modbus(daemon)} |")
    for loads in LOADS:
        served, answered = together(loads, scenario, folder)
        print(f"| {loads.name} | {of_http(served)} | {of_modbus(answered)} |", flush=True)


def together(loads: Loads, scenario: Scenario, folder: Path) -> tuple[measure.Figures | None, measure.Figures | None]:
    """Ask one program for all of it: what HTTP clients and what Modbus clients have seen."""
    with ExitStack() as stack:
        port = programs.free_port() if loads.has_modbus else 0
        http = programs.free_port() if loads.pause is not None else 0
        config, tty = (folder / "gateway.toml" if port else None), folder / f"tty-{port}"
        simulator = None
        if config is not None:
            simulator = programs.start(programs.devices(scenario, folder, [tty]), programs.processors()[0], stdout=-1)
            stack.callback(programs.end, simulator)
            programs.wait_for_ports([tty], simulator)
            config.write_text(programs.config(scenario, folder, [tty], port))
        program = started(stack, folder, config, http, port)
        asker = None
        if http:
            command = [sys.executable, __file__, str(http), str(loads.pause), str(scenario.seconds)]
            asker = programs.start(command, programs.processors()[0], stdout=-1)
        answered = asking(scenario, folder, port, program) if port else None
        served = json.loads(asker.communicate(timeout=60)[0]) if asker else None
        if answered is not None and simulator is not None:
            answered |= measure._line_figures(json.loads(programs.end(simulator)))
            best([answered])
    return served, answered


def of_http(figures: measure.Figures | None) -> str:
    """The cells of HTTP."""
    return " | | " if figures is None else f"{figures['rate']:.0f} | {figures['p50']:.1f} | {figures['p99']:.1f}"


def of_modbus(figures: measure.Figures | None) -> str:
    """The cells of Modbus, and the whole program's share of a core."""
    if figures is None:
        return " | | | "
    return f"{figures['of_line']:.3f} | {figures['p50']:.1f} | {figures['p99']:.1f} | {figures['load']:.2f}"


async def http(port: int, pause: float, seconds: float) -> None:
    """Ask the server by eight connections, and print what came of it."""
    until, took = time.monotonic() + seconds, []

    async def ask() -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while (began := time.monotonic()) < until:
            writer.write(b"GET / HTTP/1.1\r\nHost: bench\r\n\r\n")
            if b" 200 " not in await reader.readuntil(b"}"):
                raise programs.BenchError("no answer")
            took.append(time.monotonic() - began)
            await asyncio.sleep(max(0.0, pause - took[-1]))
        writer.close()

    await asyncio.gather(*(ask() for _ in range(8)))
    took.sort()
    told = {"rate": len(took) / seconds, "p50": took[len(took) // 2] * 1e3, "p99": took[len(took) * 99 // 100] * 1e3}
    print(json.dumps(told))


def main() -> None:
    """Measure; or ask by HTTP, for a part of it."""
    if sys.argv[1:]:
        port, pause, seconds = sys.argv[1:]
        asyncio.run(http(int(port), float(pause), float(seconds)))
        return
    with tempfile.TemporaryDirectory(prefix="beside.") as name:
        programs.compile_into(Path(name))
        beside(Path(name))


if __name__ == "__main__":
    main()
