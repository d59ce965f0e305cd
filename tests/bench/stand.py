"""How long the event loop stands while the gateway is asked: the longest time, with 64 lines, 192 units, 10 000 points.

    .venv/bin/python tests/bench/stand.py [--points 10000] [--rounds 5] [--only status doctor]

While it is asked, the loop counts the processor time that the gateway has used since its last turn, every half
millisecond: so other programs do not count, but threads of the gateway that keep the interpreter from the loop do.
`first` is the first question of a kind, which loads modules; `later` the median of the others, each with the
longest time of its question. Lines take no time. PYTHONPATH chooses the gateway.
"""

import argparse
import asyncio
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from struct import pack

import programs
from scenarios import Scenario

HALL = Scenario(what="", clients=4, lines=64, units="1-3", timeout=5000)
#: Seconds between two looks.
STEP = 0.0005


def serve(file: str) -> None:
    """Run the gateway, and tell the longest stand since the last question for it, in seconds, a line for each line."""
    whole = asyncio.Runner.run

    def run(self: asyncio.Runner, main, **more):
        self.get_loop().call_soon(watch, self.get_loop())
        return whole(self, main, **more)

    def watch(loop: asyncio.AbstractEventLoop) -> None:
        last, longest = time.process_time(), 0.0

        def look() -> None:
            nonlocal last, longest
            now = time.process_time()
            last, longest = now, max(longest, now - last)
            loop.call_later(STEP, look)

        def tell() -> None:
            nonlocal longest
            os.read(0, 100)
            os.write(1, f"{longest}\n".encode())
            longest = 0.0

        loop.add_reader(0, tell)
        look()

    asyncio.Runner.run = run
    from gateway.cli.main import main  # noqa: PLC0415 - the gateway of PYTHONPATH

    sys.exit(main(["run", file]))


class Gateway:
    """The gateway, and what is asked of it: `control` is its socket, `page` the port of its page."""

    def __init__(self, process: subprocess.Popen, control: Path, page: int) -> None:
        self.process, self.control, self.page = process, control, page

    def stood(self) -> float:
        """The longest stand since the last call, in seconds."""
        os.write(self.process.stdin.fileno(), b"\n")
        return float(self.process.stdout.readline())

    def ask(self, verb: str, **more: object) -> int:
        """Ask at the control socket; the bytes of the answer."""
        with socket.socket(socket.AF_UNIX) as sock:
            sock.connect(str(self.control))
            sock.sendall(json.dumps({"verb": verb, **more}).encode() + b"\n")
            with sock.makefile("rb") as stream:
                answer = stream.readline()
        if not json.loads(answer)["ok"]:
            raise programs.BenchError(answer[:300].decode())
        return len(answer)

    def get(self, path: str) -> int:
        """Ask over HTTP; the bytes of the body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.page, timeout=programs.PATIENCE)
        connection.request("GET", path)
        response = connection.getresponse()
        body = response.read()
        connection.close()
        if response.status != 200:
            raise programs.BenchError(f"{path}: {response.status} {body[:300]!r}")
        return len(body)

    def reload(self) -> int:
        """Reload, and wait until the config is applied."""
        self.process.send_signal(signal.SIGHUP)
        wait_for("config_applied", self.process)
        time.sleep(0.3)
        return 0


def wait_for(event: str, process: subprocess.Popen) -> None:
    """Wait for an event in the log."""
    said = []
    for line in process.stderr:
        said.append(line)
        if f'"{event}"' in line:
            return
    raise programs.BenchError(f"the gateway has not said {event}: {''.join(said)}")


@contextmanager
def gateway(tools: Path, points: int) -> Iterator[Gateway]:
    """A gateway whose units have all been asked once."""
    with tempfile.TemporaryDirectory(prefix="stand.") as name:
        folder = Path(name)
        ttys = [folder / f"tty{number}" for number in range(HALL.lines)]
        simulator = programs.start(
            programs.devices(HALL, tools, ttys), programs.processors()[0], stdout=subprocess.PIPE
        )
        try:
            programs.wait_for_ports(ttys, simulator)
            port, page, each = programs.free_port(), programs.free_port(), max(1, points // 192)
            text = programs.config(HALL, folder, [*ttys], port).replace('timeout = "', 'profile = "p", timeout = "')
            rows = "".join(f'{{ name = "point-{n}", holding = {n}, unit = "V" }},\n' for n in range(each))
            file = folder / "gateway.toml"
            file.write_text(f'{text}[web]\nbind = "http://127.0.0.1:{page}"\n[profile.p]\npoints = [\n{rows}]\n')
            own = os.environ | {"STATE_DIRECTORY": name, "RUNTIME_DIRECTORY": name}
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
            command = [sys.executable, __file__, "--serve", file]
            process = programs.start(command, programs.processors()[1], env=own, **pipes)
            try:
                wait_for("ready", process)
                read_all(port, each)
                yield Gateway(process, folder / "control.sock", page)
            finally:
                process.kill()
                process.communicate()
        finally:
            programs.end(simulator)


def read_all(port: int, registers: int) -> None:
    """Read all registers of all units that are points, so that they have values."""
    with socket.create_connection(("127.0.0.1", port), programs.PATIENCE) as sock:
        for line in range(HALL.lines):
            for unit in range(1, 4):
                for first in range(0, registers, 100):
                    count = min(100, registers - first)
                    sock.sendall(pack(">HHHBBHH", 1, 0, 6, HALL.line_step * line + unit, 3, first, count))
                    sock.recv(9 + 2 * count, socket.MSG_WAITALL)


QUESTIONS: dict[str, Callable[[Gateway], int]] = {
    "idle": lambda it: time.sleep(0.5) or 0,
    "status": lambda it: it.ask("status"),
    "doctor --passive": lambda it: it.ask("doctor", ask=False),
    "doctor": lambda it: it.ask("doctor", ask=True),
    "units": lambda it: it.ask("units"),
    "values": lambda it: it.ask("values"),
    "/api/v1/status": lambda it: it.get("/api/v1/status"),
    "/api/v1/values": lambda it: it.get("/api/v1/values"),
    "/metrics": lambda it: it.get("/metrics"),
    "reload": lambda it: it.reload(),
}


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--serve"]:
        serve(sys.argv[2])
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5, help="how often each is asked")
    parser.add_argument("--only", nargs="+", choices=QUESTIONS, default=list(QUESTIONS), metavar="QUESTION")
    args = parser.parse_args()
    if args.rounds < 2:
        parser.error("--rounds: at least 2, as the first question is not like those after it")
    programs.compile_gateway()
    with tempfile.TemporaryDirectory() as name:
        programs.compile_into(Path(name))
        with gateway(Path(name), args.points) as it:
            print("| asked | first ms | later ms | KiB |\n|---|---:|---:|---:|")
            for question in args.only:
                stood, size = [], 0
                for _ in range(args.rounds):
                    it.stood()
                    size = QUESTIONS[question](it)
                    time.sleep(0.05)
                    stood.append(1000 * it.stood())
                    time.sleep(1.1)
                print(f"| {question} | {stood[0]:.1f} | {median(stood[1:]):.1f} | {size / 1024:.0f} |", flush=True)


if __name__ == "__main__":
    main()
