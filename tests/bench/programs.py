"""The programs of a run: simulated devices, a load, and what is between them."""

import ctypes
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from scenarios import Scenario

HERE = Path(__file__).parent

#: How long a program may take to start or to end, in seconds.
PATIENCE = 20.0
#: The kernel gives out those from 32768 on, and tests take others.
PORTS = range(10_000, 20_000)

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1

Words = list[str | Path]
#: The installed one, unless PYTHONPATH leads to another.
GATEWAY: Words = [sys.executable, "-P", "-m", "gateway.cli.main", "run"]


class BenchError(Exception):
    """A run has not come to its end; the message says why."""


def compile_gateway(other: Path | None = None) -> None:
    """See that the installed gateway is that of the checkout, and compiled. Nothing of one that PYTHONPATH leads to.

    The same for that of an `other` checkout.
    """
    ours = [] if "PYTHONPATH" in os.environ else [HERE.parents[1]]
    for checkout in [*ours, *([other] if other else [])]:
        subprocess.run([checkout / "deploy/go", "compile"], check=False)  # it says why not


def compile_into(folder: Path) -> None:
    """Build the programs in C."""
    for name in ("devices", "load", "relay"):
        flags = ["-O2", "-Wall", "-Wextra", "-Wno-unused-result"]
        subprocess.run([os.environ.get("CC", "cc"), *flags, "-o", folder / name, HERE / f"{name}.c"], check=True)


def processors() -> tuple[set[int], set[int]]:
    """Where devices and load run, and where the gateway does; the same set twice where there is only one processor."""
    first, *others = sorted(os.sched_getaffinity(0))
    return {first}, {others[0] if others else first}


def start(command: Words, on: set[int], **more: Any) -> subprocess.Popen:
    """Start a program on these processors. It does not outlive this process."""

    def in_child() -> None:
        os.sched_setaffinity(0, on)
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)

    return subprocess.Popen(command, text=True, preexec_fn=in_child, **more)  # noqa: PLW1509 - no threads


@contextmanager
def busy(number: int) -> Iterator[None]:
    """So many programs in an endless loop, of ordinary priority, on all processors in turn."""
    ours = sorted(os.sched_getaffinity(0))
    with ExitStack() as stack:
        for each in range(number):
            program = start([sys.executable, "-I", "-S", "-c", "while True: pass"], {ours[each % len(ours)]})
            os.sched_setscheduler(program.pid, os.SCHED_OTHER, os.sched_param(0))
            stack.callback(end, program)
        yield


def end(program: subprocess.Popen) -> str:
    """Stop a program; what it still printed."""
    program.terminate()
    try:
        return program.communicate(timeout=PATIENCE)[0] or ""
    except subprocess.TimeoutExpired:
        program.kill()
        return program.communicate()[0] or ""


def devices(scenario: Scenario, tools: Path, ttys: list[Path]) -> Words:
    """The command that simulates the lines."""
    words = ["--line-step", scenario.line_step, "--units", scenario.units, "--baud", scenario.baud, "--bits", 10]
    if scenario.dead is not None:
        words += ["--dead", scenario.dead]
    if scenario.dead_line is not None:
        words += ["--dead-port", scenario.dead_line]
    words += ["--stamp"] * scenario.same_read + ["--ascii"] * scenario.is_ascii
    for tty in ttys:
        words += ["--link", tty]
    return [tools / "devices", *map(str, words)]


def load(scenario: Scenario, tools: Path, port: int, process: int) -> Words:
    """The command that asks the gateway at `port`, which is `process`."""
    options = ["--conns", scenario.clients, "--idle", scenario.idle, "--one-listener", "--watch", process]
    prefix = "" if scenario.speak == "tcp" else f"{scenario.speak}:"
    return _load(scenario, tools, options, [f"{prefix}127.0.0.1:{port}"] * scenario.lines)


def load_on_line(scenario: Scenario, tools: Path, tty: Path) -> Words:
    """The command that asks on the line itself."""
    return _load(scenario, tools, ["--conns", 1], [f"rtu:{tty}"])


def _load(scenario: Scenario, tools: Path, options: list, targets: list[str]) -> Words:
    words = ["--line-step", scenario.line_step, *options, "--timeout", scenario.patience]
    words += [
        "--pipeline",
        scenario.in_flight,
        "--count",
        scenario.count,
        "--think",
        scenario.think,
        "--exc-think",
        scenario.think_after_exception,
    ]
    words += ["--warmup", scenario.warmup, "--seconds", scenario.seconds]
    words += ["--sticky"] * scenario.sticky + ["--span", 1, "--fresh"] * scenario.same_read
    for target in targets:
        words += ["--target", f"{target}={scenario.units}"]
    return [tools / "load", *map(str, words)]


def relay(scenario: Scenario, tools: Path, ttys: list[Path], port: int, *, wakes_for_each_byte: bool = False) -> Words:
    """The command of the bare relay, which sleeps until a response can be complete; or else not."""
    options = ["--ascii"] * scenario.is_ascii + (["--gap", "--baud", str(scenario.baud)] if scenario.baud else [])
    options += ["--each-byte"] * wakes_for_each_byte
    step = scenario.line_step
    return [
        tools / "relay",
        *options,
        *(f"{tty}={port}:{step * i + 1}-{step * i + step}" for i, tty in enumerate(ttys)),
    ]


def gateway(
    scenario: Scenario,
    folder: Path,
    places: Words,
    port: int,
    more_config: str = "",
    program: Words = GATEWAY,
) -> Words:
    """The command of the gateway, or of another `program`; its config is written into `folder`."""
    file = folder / "gateway.toml"
    file.write_text(config(scenario, folder, places, port) + more_config)
    return [*program, file]


def gateway_of(checkout: Path) -> Words:
    """The gateway that is installed in another checkout."""
    return ["env", "-u", "PYTHONPATH", checkout.absolute() / ".venv/bin/python", *GATEWAY[1:]]


def config(scenario: Scenario, folder: Path, places: Words, port: int) -> str:
    """The gateway's config: one line for each place, which is a tty, or the address of the server that has it."""
    text = f"""
[control]
socket = "{folder}/control.sock"
[log]
format = "json"
"""
    for speak in ("tcp", "udp") if scenario.speak == "udp" else (scenario.speak,):
        text += f"""
[[listen]]
bind    = "{speak}://127.0.0.1:{port}"
clients = {scenario.clients + scenario.idle + 32}
idle    = "0"
"""
    place_of = _server if scenario.behind_server else _line
    return text + "".join(place_of(scenario, i, place) for i, place in enumerate(places))


def _line(scenario: Scenario, number: int, tty: str | Path) -> str:
    units = f'unit = "{scenario.units}", as = "{_known_as(scenario, number)}"'
    return f"""
[[line]]
name     = "line{number}"
port     = "{tty}"
mode     = "{"ascii" if scenario.is_ascii else "rtu"}"
baud     = {scenario.baud or 115200}
format   = "{"7E1" if scenario.is_ascii else "8N1"}"
gap      = "{"auto" if scenario.baud else "0"}"
queue    = {scenario.queue or max(64, scenario.clients)}
max_wait = "30 s"
coalesce = {json.dumps(scenario.coalesce)}
devices  = [{{ {units}, name = "line{number}-*", timeout = "{scenario.timeout} ms" }}]
"""


def _server(scenario: Scenario, number: int, address: str | Path) -> str:
    known_as = _known_as(scenario, number)
    return f"""
[[upstream]]
to       = "{address}"
units    = [{{ unit = "{known_as}", as = "{known_as}" }}]
"""


def _known_as(scenario: Scenario, line: int) -> str:
    first, _, last = scenario.units.partition("-")
    shift = scenario.line_step * line
    return "-".join(str(int(unit) + shift) for unit in (first, last) if unit)


def free_port() -> int:
    """A TCP port that nobody uses at the moment: none of those that the kernel gives to whoever asks."""
    while True:
        number = random.choice(PORTS)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", number))
            return number


def wait_for_ports(ttys: list[Path], program: subprocess.Popen) -> None:
    """Wait until the simulated lines are there."""
    _wait_until(ttys[-1].exists, program, "no simulated lines")


def wait_for_listener(port: int, program: subprocess.Popen, patience: float = PATIENCE) -> None:
    """Wait until connections to `port` are taken, for at most so many seconds."""

    def is_taken() -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    _wait_until(is_taken, program, "nothing listens", patience)


def _wait_until(
    is_ready: Callable[[], bool], program: subprocess.Popen, otherwise: str, patience: float = PATIENCE
) -> None:
    until = time.monotonic() + patience
    while not is_ready():
        if program.poll() is not None or time.monotonic() > until:
            raise BenchError(f"{otherwise}, status {program.poll()}")
        time.sleep(0.02)
