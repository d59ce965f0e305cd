"""What `check`, a start and a reload take, and how much memory, beside what Python needs for nothing.

    .venv/bin/python tests/bench/start.py [--busy 4]

Eight lines on virtual ports, one of them alone, and with 10 000 points in 50 profiles. Medians, the longest time, and
the least CPU time, with that of the process that reads the config. The first start compiles Python's modules, as an
installer does, and is left out. `CPU` is what counts on a busy machine; `--busy` adds programs in endless loops.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from threading import Timer
from typing import NamedTuple

from programs import GATEWAY, PATIENCE, busy, compile_gateway, config
from scenarios import Scenario
from used import cpu, resident

LINES = Scenario(what="", clients=1, lines=8)
PROFILES, POINTS = 50, 200
HELP, CHECK = [*GATEWAY[:-1], "--help"], [*GATEWAY[:-1], "check"]
#: Starts a program and tells what it took. The kernel counts the memory of whoever starts a program as that program's,
#: so this one has loaded nothing.
LAUNCHER = """
import os, sys, time
began = time.perf_counter()
silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
program = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=silent)
_, status, used = os.wait4(program, 0)
print(time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
sys.exit(status != 0)
"""
#: A program with an event loop that does nothing.
NOTHING = [sys.executable, "-c", "import asyncio; asyncio.run(asyncio.sleep(0))"]
#: A program that does not stop.


class Start(NamedTuple):
    """Seconds until it was ready or over, seconds of CPU time until then, memory in MiB."""

    wall: float
    cpu: float
    memory: float


def until_end(command: list[str], environment: dict[str, str]) -> Start:
    """A program that ends by itself."""
    launch = [sys.executable, "-I", "-S", "-c", LAUNCHER, *command]
    ended = subprocess.run(launch, stdout=subprocess.PIPE, text=True, env=environment, check=True, timeout=PATIENCE)
    return Start(*map(float, ended.stdout.split()))


def until_ready(file: Path, environment: dict[str, str]) -> Start:
    """The gateway with this config, until it says that it is ready."""
    began = time.perf_counter()
    with _gateway(file, environment) as program:
        return Start(time.perf_counter() - began, cpu(program.pid, with_children=True), resident(program.pid) / 1024)


def until_applied(file: Path, environment: dict[str, str]) -> Start:
    """A reload, until it says that the config is applied; the memory is that after it."""
    with _gateway(file, environment) as program:
        began, used = time.perf_counter(), cpu(program.pid, with_children=True)
        program.send_signal(signal.SIGHUP)
        _wait_for("config_applied", program)
        return Start(
            time.perf_counter() - began, cpu(program.pid, with_children=True) - used, resident(program.pid) / 1024
        )


@contextmanager
def _gateway(file: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen]:
    program = subprocess.Popen([*GATEWAY, file], stderr=subprocess.PIPE, text=True, env=environment)
    killer = Timer(PATIENCE, program.kill)
    killer.start()
    try:
        _wait_for("ready", program)
        yield program
    finally:
        killer.cancel()
        program.terminate()
        program.communicate()


def _wait_for(event: str, program: subprocess.Popen) -> None:
    log = []
    for line in program.stderr:
        log.append(line)
        if f'"{event}"' in line:
            return
    raise SystemExit(f"the gateway has not said {event}: {''.join(log)}")


def _environment(compiled: Path) -> dict[str, str]:
    """With a folder for what Python makes of modules when it first reads them."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": str(compiled)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return environment


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7, help="how often each is started")
    parser.add_argument("--busy", type=int, default=0, help="how many programs compute meanwhile")
    args = parser.parse_args()
    compile_gateway()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bench.")))
        ttys = [_virtual_port(stack) for _ in range(LINES.lines)]
        usual = config(LINES, folder, ttys, port=0)
        alone = config(replace(LINES, lines=1, units="1"), folder, ttys[:1], port=0)
        configs = {"8 lines": usual, "1 unit": alone, f"{PROFILES * POINTS} points": usual + _points()}
        environment = _environment(folder)
        kinds: dict[str, Callable[[], Start]] = {
            "Python and asyncio, nothing else": lambda: until_end(NOTHING, environment),
            "`--help`": lambda: until_end(HELP, environment),
        }
        for number, (name, text) in enumerate(configs.items()):
            file = folder / f"{number}.toml"
            file.write_text(text)
            kinds[f"`check`, {name}"] = partial(until_end, [*CHECK, str(file)], environment)
            kinds[f"`run` until ready, {name}"] = partial(until_ready, file, environment)
            kinds[f"a reload, {name}"] = partial(until_applied, file, environment)
        for start in kinds.values():
            start()
        stack.enter_context(busy(args.busy))
        starts = {name: [] for name in kinds}
        for _ in range(args.rounds):
            for name, start in kinds.items():
                starts[name].append(start())
    print("| | ms | longest | least CPU ms | MiB |\n|---|---:|---:|---:|---:|")
    for name, found in starts.items():
        wall, _, memory = (median(figures) for figures in zip(*found, strict=True))
        longest, least = max(start.wall for start in found), min(start.cpu for start in found)
        print(f"| {name} | {wall * 1000:.0f} | {longest * 1000:.0f} | {least * 1000:.0f} | {memory:.1f} |")


def _points() -> str:
    """Profiles with 10 000 points, and for each a device, on a line that has no port."""
    text, devices = "", ""
    for profile in range(PROFILES):
        rows = "".join(f'  {{ name = "value-{n}", holding = {n}, unit = "V", scale = 0.1 }},\n' for n in range(POINTS))
        text += f"[profile.kind-{profile}]\npoints = [\n{rows}]\n"
        devices += f'{{ unit = {180 + profile}, name = "many-{profile}", profile = "kind-{profile}" }}, '
    return f'{text}[[line]]\nport = "/dev/none"\ndevices = [{devices}]\n'


def _virtual_port(stack: ExitStack) -> Path:
    """A pseudo-terminal that nobody answers on."""
    ends = os.openpty()
    for end in ends:
        stack.callback(os.close, end)
    return Path(os.ttyname(ends[1]))


if __name__ == "__main__":
    main()
