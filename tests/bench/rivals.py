"""Other gateways on the same simulated lines, in turns with this one.

    PYTHONPATH= .venv/bin/python tests/bench/rivals.py --mbusd PATH [...]

A program that is not given is left out. docs/comparison.md says which versions were measured, and how they were built.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import measure
import programs
from programs import BenchError, Words
from scenarios import SCENARIOS, Scenario

#: What each gateway waits for a response, in milliseconds; all have the same.
TIMEOUT = 500
#: Every tenth answer of a device comes after that, in microseconds: while the next request is under way.
LATE = "10:550000"

_PACED = "latency19200", "line19200", "line115200"
_LATE = Scenario(
    what="2 clients of one unit; every tenth answer comes after the time limit",
    clients=2,
    baud=19200,
    units="1",
    think_after_exception=20,
    timeout=TIMEOUT,
    warmup=1,
    seconds=20,
    patience=20,
)
MEASURED: dict[str, Scenario] = {
    "latency": SCENARIOS["latency"],
    **{name: SCENARIOS[name] for name in _PACED},
    "port1": SCENARIOS["port1"],
    "dead": replace(SCENARIOS["dead"], timeout=TIMEOUT, warmup=5, seconds=20),
    "late": _LATE,
    "upstream1": SCENARIOS["upstream1"],
}

#: How a program is started: for a scenario, in a folder, on a tty (or before the server at an address), at a port.
Starter = Callable[[Scenario, Path, Path | str, int], Words]


def mbusd(program: Path) -> Starter:
    """Start mbusd with the shortest pause that keeps t3.5, in its whole milliseconds, and its own three retries."""

    def start(scenario: Scenario, _: Path, tty: Path | str, port: int) -> Words:
        options = f"-d -L - -v 0 -m 8n1 -A 127.0.0.1 -C 128 -T 0 -W {TIMEOUT} -R {2 if scenario.baud else 1}"
        return [program, *options.split(), "-p", tty, "-s", str(scenario.baud or 115200), "-P", str(port)]

    return start


def in_go(program: Path) -> Starter:
    """Start ffutop/modbus-gateway."""

    def start(scenario: Scenario, folder: Path, tty: Path | str, port: int) -> Words:
        serial = {"device": str(tty), "baud_rate": scenario.baud or 115200, "data_bits": 8, "parity": "N"}
        serial |= {"stop_bits": 1, "timeout": f"{TIMEOUT}ms", "rqst_pause": "2ms" if scenario.baud else "1us"}
        upstream = {"type": "tcp", "tcp": {"address": f"127.0.0.1:{port}"}}
        line = {"type": "rtu", "slave_ids": "1-247", "serial": serial}
        one = {"name": "one", "upstreams": [upstream], "downstreams": [line]}
        file = folder / "config.json"
        file.write_text(json.dumps({"gateways": [one], "log": {"level": "error"}}))
        return [program, "-config", file]

    return start


def in_cpp(program: Path) -> Starter:
    """Start petukhovtd/modbus_gateway."""

    def start(scenario: Scenario, folder: Path, tty: Path | str, port: int) -> Words:
        serial = {"frame_type": "rtu", "timeout_ms": TIMEOUT, "device": str(tty), "baud_rate": scenario.baud or 115200}
        serial |= {"character_size": 8, "parity": "none", "stop_bits": 1, "flow_control": "none"}
        serial["unit_id"] = [{"type": "range", "begin": 1, "end": 247}]
        service = {"log_level": "critical", "threads": 1}
        slave = {"frame_type": "tcp", "ip_address": "127.0.0.1", "ip_port": port}
        file = folder / "config.json"
        file.write_text(json.dumps({"service": service, "slaves": [slave], "masters": [serial]}))
        return [program, "-c", file]

    return start


def in_python(program: Path) -> Starter:
    """Start modbus-gateway of PyPI, which is tspspi/modbusgw."""

    def start(scenario: Scenario, folder: Path, tty: Path | str, port: int) -> Words:
        front = {"id": "front", "type": "tcp_modbus_tcp", "host": "127.0.0.1", "port": port}
        back = {"id": "back", "type": "pyserial", "device": str(tty), "baudrate": scenario.baud or 115200}
        back |= {"parity": "N", "stop_bits": 1, "request_timeout_ms": TIMEOUT}
        match = {"unit_ids": ["*"], "function_codes": ["*"]}
        config = {
            "service": {"log_level": "ERROR", "pid_file": f"{folder}/pid", "state_dir": str(folder)},
            "bus": {"request_queue_size": 64, "response_timeout_ms": 5000},
            "frontends": [front],
            "backends": [back],
            "routes": [{"frontend": "front", "backend": "back", "match": match, "mirror_to_mqtt": []}],
        }
        file = folder / "config.json"
        file.write_text(json.dumps(config))
        return [program, "-c", file, "start", "--foreground"]

    return start


def proxy(program: Path) -> Starter:
    """Start modbus-proxy, which knows Modbus TCP servers only."""
    return lambda _, __, server, port: [program, "--bind", f"tcp://127.0.0.1:{port}", "--modbus", server]


def ours(program: Words) -> Starter:
    return lambda scenario, folder, tty, port: programs.gateway(
        replace(scenario, timeout=TIMEOUT), folder, [tty], port, program=program
    )


def bare_relay(tools: Path) -> Starter:
    return lambda scenario, _, tty, port: programs.relay(scenario, tools, [tty], port)


def run(name: str, tools: Path, starter: Starter | None) -> measure.Figures:
    """Measure one program, or, without one, a client on the line itself.

    Raises:
        BenchError: something has not started, or the load has not come to its end.
    """
    scenario = MEASURED[name]
    with tempfile.TemporaryDirectory(prefix="rivals.") as folder, ExitStack() as stack:
        tty = Path(folder) / "tty0"
        others, own = programs.processors()
        late = ["--late", LATE] if name == "late" else []
        simulator = programs.start([*programs.devices(scenario, tools, [tty]), *late], others, stdout=-1)
        stack.callback(programs.end, simulator)
        programs.wait_for_ports([tty], simulator)
        if starter is None:
            return measure.asked(scenario, programs.load_on_line(scenario, tools, tty))
        port, place = programs.free_port(), tty
        if scenario.behind_server:
            server = programs.free_port()
            command = programs.relay(scenario, tools, [tty], server)
            stack.enter_context(measure.running("server", command, others, server, Path(folder)))
            place = f"tcp://127.0.0.1:{server}"
        command = starter(scenario, Path(folder), place, port)
        between = stack.enter_context(measure.running("between", command, own, port, Path(folder)))
        return measure.asked(scenario, programs.load(scenario, tools, port, between.pid))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    makers = {"mbusd": mbusd, "go": in_go, "cpp": in_cpp, "python": in_python, "proxy": proxy}
    for each in makers:
        parser.add_argument(f"--{each}", type=Path, metavar="PROGRAM")
    parser.add_argument("--checkout", type=Path, metavar="FOLDER", help="the one whose gateway is measured")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("names", nargs="*", default=[*MEASURED], metavar="SCENARIO", help=", ".join(MEASURED))
    args = parser.parse_args()
    gateway = programs.gateway_of(args.checkout) if args.checkout else programs.GATEWAY
    with tempfile.TemporaryDirectory(prefix="rivals.") as name:
        tools = Path(name)
        programs.compile_into(tools)
        starters: dict[str, Starter | None] = {"direct": None, "relay": bare_relay(tools), "ours": ours(gateway)}
        starters |= {each: make(path.resolve()) for each, make in makers.items() if (path := getattr(args, each))}
        for scenario in args.names:
            for each, starter in starters.items():
                if not _can(each, scenario):
                    continue
                for _ in range(args.rounds):
                    print(f"{scenario:13}{each:8}{_shown(scenario, tools, starter)}", flush=True)
    return 0


def _can(program: str, name: str) -> bool:
    """Whether a program is asked in a scenario. The relay waits for ever where a unit is dead."""
    if MEASURED[name].behind_server or program == "proxy":
        return program in ("ours", "proxy") and MEASURED[name].behind_server
    return MEASURED[name].has_direct if program == "direct" else program != "relay" or name not in ("dead", "late")


def _shown(scenario: str, tools: Path, starter: Starter | None) -> str:
    try:
        found = run(scenario, tools, starter)
    except BenchError as error:
        return f" {error}"
    shown = ("rate", "of_line", "p50", "p99", "cpu", "memory", "wrong", "lost", "exceptions")
    return "".join(f"{each:>11} {found[each]:<8.3f}" for each in shown)


if __name__ == "__main__":
    sys.exit(main())
