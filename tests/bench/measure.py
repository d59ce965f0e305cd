"""One run of one scenario, and its figures."""

import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from statistics import median
from typing import Any

import programs
from programs import BenchError
from scenarios import Scenario
from used import resident

#: What a program between clients and lines does after its start, before it is measured, in seconds.
SETTLING = 0.5

Figures = dict[str, float]

#: What must not be.
FAULTS = ("wrong", "lost", "exceptions", "line_faults")


def run(
    scenario: Scenario,
    tools: Path,
    between: str,
    more_config: str = "",
    beside: AbstractContextManager[None] | None = None,
    program: programs.Words = programs.GATEWAY,
) -> Figures:
    """Measure `gateway`, `relay` or `each-byte`, which is the other relay, or `direct`, a client on the line itself.

    A gateway runs in the context `beside`, and may be another `program`.

    Raises:
        BenchError: something has not started, or the load has not come to its end.
    """
    with tempfile.TemporaryDirectory(prefix="bench.") as name:
        ttys = [Path(name) / f"tty{i}" for i in range(scenario.lines)]
        command = programs.devices(scenario, tools, ttys)
        simulator = programs.start(command, programs.processors()[0], stdout=-1)
        try:
            programs.wait_for_ports(ttys, simulator)
            if between == "direct":
                figures = asked(scenario, programs.load_on_line(scenario, tools, ttys[0]))
            else:
                figures = _run(scenario, tools, Path(name), ttys, between, more_config, beside, program)
        finally:
            seen = programs.end(simulator)
        if not seen:
            raise BenchError("the simulated devices have not come to their end")
        return figures | _line_figures(json.loads(seen))


def _run(
    scenario: Scenario,
    tools: Path,
    folder: Path,
    ttys: list[Path],
    between: str,
    more_config: str,
    beside: AbstractContextManager[None] | None,
    program: programs.Words,
) -> Figures:
    others, own = programs.processors()
    port = programs.free_port()
    with ExitStack() as stack:
        if between != "gateway":
            command = programs.relay(scenario, tools, ttys, port, wakes_for_each_byte=between == "each-byte")
        elif scenario.behind_server:
            server = programs.free_port()
            relay = programs.relay(scenario, tools, ttys, server)
            stack.enter_context(running("server", relay, others, server, folder))
            command = programs.gateway(scenario, folder, [f"tcp://127.0.0.1:{server}"], port, program=program)
        else:
            command = programs.gateway(scenario, folder, ttys, port, more_config, program)
        measured = stack.enter_context(running(between, command, own, port, folder))
        stack.enter_context(beside or nullcontext())
        before = resident(measured.pid)
        counted = _load(scenario, programs.load(scenario, tools, port, measured.pid))
        memory_each = (counted["gw_rss_kb"] - before) / (scenario.idle or scenario.clients)
        return _figures(scenario, counted) | {"memory_each": memory_each}


@contextmanager
def running(name: str, command: programs.Words, on: set[int], port: int, folder: Path) -> Iterator[subprocess.Popen]:
    """A program that listens at this port, ready to be measured."""
    log = folder / f"{name}.log"
    with log.open("w") as output:
        program = programs.start(command, on, stdout=output, stderr=output)
    try:
        programs.wait_for_listener(port, program)
        time.sleep(SETTLING)
        yield program
    except BenchError as error:
        raise BenchError(f"{name}: {error}; its log ends: {log.read_text()[-500:]}") from error
    finally:
        programs.end(program)


def asked(scenario: Scenario, command: programs.Words) -> Figures:
    """What a load tells, of whatever it asks."""
    return _figures(scenario, _load(scenario, command))


def _load(scenario: Scenario, command: programs.Words) -> dict[str, Any]:
    generator = programs.start(command, programs.processors()[0], stdout=-1)
    try:
        output, _ = generator.communicate(timeout=scenario.warmup + scenario.seconds + scenario.patience + 60)
    except subprocess.TimeoutExpired as error:
        raise BenchError("the load does not come to its end") from error
    finally:
        programs.end(generator)
    if generator.returncode:
        raise BenchError(f"the load ended with status {generator.returncode}")
    return json.loads(output)


def _figures(scenario: Scenario, counted: dict[str, Any]) -> Figures:
    """Rates a second, times in milliseconds, `cpu` in microseconds an answer, `memory` in MiB.

    A line with a `queue` of its own may refuse a request: that counts as `refused` and is no fault.
    """
    refused = counted["exc06"] if scenario.queue else 0
    return {
        "rate": counted["rate"],
        "of_line": counted["pace"] / scenario.line_limit if scenario.baud else 0.0,
        "p50": counted["p50_us"] / 1000,
        "p99": counted["p99_us"] / 1000,
        "tail": (counted["p99_us"] - counted["p50_us"]) / 1000,
        "cpu": counted["gw_cpu_ms_per_1000"],
        "load": counted["gw_cpu_s"] / counted["seconds"],
        "memory": counted["gw_rss_kb"] / 1024,
        "wrong": sum(counted[kind] for kind in ("bad_tid", "bad_unit", "bad_data", "bad_frame", "stale")),
        "lost": sum(counted[kind] for kind in ("timeouts", "closed", "conn_fail", "idle_closed"))
        + (scenario.idle - counted["idle_ok"]),
        "refused": refused / (scenario.warmup + scenario.seconds),
        "exceptions": sum(n for unit, n in counted["exceptions_by"].items() if scenario.lives(int(unit))) - refused,
    }


def _line_figures(seen: dict[str, Any]) -> Figures:
    """What the simulated devices saw: `silence` is the mean one before a request, in t3.5."""
    faults = ("gap_violations", "early", "merged", "crc_errors", "foreign")
    return {
        "silence": seen["mean_gap_us"] / seen["t35_us"] if seen["t35_us"] else 0.0,
        "line_faults": sum(seen[kind] for kind in faults),
    }


def together(runs: list[Figures]) -> Figures:
    """The median of each figure; the least processor time, because other work only adds to it; all faults."""
    found = {name: median(each[name] for each in runs) for name in runs[0]}
    found["cpu"] = min(each["cpu"] for each in runs)
    return found | {name: sum(each[name] for each in runs) for name in FAULTS}
