"""What noise on a line costs: random bytes at the full rate of 115200 baud, as a UART hands them over.

    .venv/bin/python tests/bench/noisy_line.py

`idle`: nobody asks. `asked`: a client reads again and again, and gets its answers in short pauses of the noise.
`resting`: 30 units that do not answer rest. `server`: the gateway is a server on the line. The last column is the
processor time of the gateway as a share of a core: that of the best round, because other work only adds to it. Ends
with status 1 if one is above GOAL.
"""

import argparse
import os
import random
import socket
import struct
import tempfile
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import NamedTuple

import programs
from programs import BenchError
from used import cpu

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu

GOAL = 0.10
#: Bytes a second.
RATE = 11520
#: So many bytes a UART hands over at once: its FIFO has 16, and it tells of 8 or 14.
CHUNK = 12
#: In `asked`: so long is noise, and so long a pause, in seconds.
NOISE, PAUSE = 0.1, 0.01
#: A client asks again so many seconds after an answer.
PACE = 0.005
#: So long is noise before it is measured, in seconds.
SETTLING = 0.5
LIVING, DEAD = 1, range(2, 32)
READ = bytes.fromhex("03 0010 000A")
ANSWER = bytes((3, 20)) + bytes(20)


class Kind(NamedTuple):
    """One row of the table."""

    name: str
    mode: str
    is_asked: bool = False
    has_resting: bool = False
    is_server: bool = False


KINDS = [
    Kind(f"{mode} {name}", mode, **options)
    for mode in ("rtu", "ascii")
    for name, options in {
        "idle": {},
        "idle, resting": {"has_resting": True},
        "asked": {"is_asked": True},
        "asked, resting": {"is_asked": True, "has_resting": True},
        "server": {"is_server": True},
    }.items()
]


def config(kind: Kind, folder: Path, port: str, listener: int) -> str:
    """The gateway's config."""
    units = f"{LIVING}-{DEAD[-1]}"
    role = (
        'role = "server"\nserves = [100]'
        if kind.is_server
        else f'devices = [{{ unit = "{units}", as = "{units}", name = "d-*", timeout = "20 ms" }}]'
    )
    image = "[[image]]\nunit = 100\nholding = 100\n" if kind.is_server else ""
    return f"""
[control]
socket = "{folder}/control.sock"
[log]
format = "json"
[[listen]]
bind = "tcp://127.0.0.1:{listener}"
{image}
[[line]]
name   = "noisy"
port   = "{port}"
mode   = "{kind.mode}"
baud   = 115200
format = "8N1"
{role}
"""


class Asker:
    """A Modbus TCP client."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=programs.PATIENCE)

    def ask(self, unit: int) -> int:
        """Read ten registers; the function code of the answer."""
        self._socket.sendall(mbap.encode(1, unit, READ))
        head = self._read(8)
        self._read(struct.unpack(">H", head[4:6])[0] - 2)
        return head[7]

    def close(self) -> None:
        self._socket.close()

    def _read(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            more = self._socket.recv(size - len(data))
            if not more:
                raise BenchError("the gateway has closed the connection")
            data += more
        return data


class Line:
    """The far end of the line: noise, and one unit that lives."""

    def __init__(self, mode: str) -> None:
        self._far, self._near = os.openpty()
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self.port = os.ttyname(self._near)
        framing = rtu if mode == "rtu" else ascii_framing
        self._request, self._answer = framing.encode(LIVING, READ), framing.encode(LIVING, ANSWER)
        self._dice = random.Random(1)
        self._heard = b""

    def make_noise(self, seconds: float, *, with_pauses: bool) -> int:
        """How many bytes were sent."""
        sent, began = 0, time.monotonic()
        for step in range(int(seconds * RATE / CHUNK)):
            time.sleep(max(0.0, began + step * CHUNK / RATE - time.monotonic()))
            self._reply()
            if not with_pauses or step * CHUNK / RATE % (NOISE + PAUSE) < NOISE:
                sent += os.write(self._far, self._dice.randbytes(CHUNK))
        return sent

    def drain(self) -> None:
        """Answer nobody."""
        self._heard = b""
        try:
            while os.read(self._far, 4096):
                pass
        except BlockingIOError:
            pass

    def _reply(self) -> None:
        try:
            self._heard += os.read(self._far, 4096)
        except BlockingIOError:
            return
        if self._request in self._heard:
            self._heard = b""
            os.write(self._far, self._answer)

    def close(self) -> None:
        os.close(self._far)
        os.close(self._near)


def measured(kind: Kind, seconds: float) -> tuple[float, float]:
    """Processor time of the gateway as a share of a core at RATE, and how many answers a second the client got.

    Raises:
        BenchError: something has not started, or the units do not rest.
    """
    others, own = programs.processors()
    os.sched_setaffinity(0, others)
    line, listener = Line(kind.mode), programs.free_port()
    with tempfile.TemporaryDirectory(prefix="bench.") as name:
        file, log = Path(name, "gateway.toml"), Path(name, "log")
        file.write_text(config(kind, Path(name), line.port, listener))
        with log.open("w") as output:
            gateway = programs.start([*programs.GATEWAY, file], own, stdout=output, stderr=output)
        try:
            programs.wait_for_listener(listener, gateway)
            if kind.has_resting:
                let_rest(line, listener)
            line.make_noise(SETTLING, with_pauses=kind.is_asked)
            if log.read_text().count("unit_resting") < len(DEAD) * kind.has_resting:
                raise BenchError(f"not all units rest: {log.read_text()[-500:]}")
            with asked(listener, wanted=kind.is_asked) as answers:
                before = cpu(gateway.pid)
                sent = line.make_noise(seconds, with_pauses=kind.is_asked)
                return (cpu(gateway.pid) - before) / sent * RATE, answers[0] / seconds
        finally:
            programs.end(gateway)
            line.close()


def let_rest(line: Line, listener: int) -> None:
    """Ask units that do not answer, until they rest."""
    client = Asker(listener)
    for _ in range(3):
        for unit in DEAD:
            client.ask(unit)
            line.drain()
    client.close()


@contextmanager
def asked(listener: int, *, wanted: bool) -> Iterator[list[int]]:
    """A client reads all the time, if it is wanted to; how many answers it got."""
    answers, is_over = [0], Event()

    def ask() -> None:
        client = Asker(listener)
        while not is_over.wait(PACE):
            answers[0] += client.ask(LIVING) == READ[0]
        client.close()

    thread = Thread(target=ask, daemon=True)
    if wanted:
        thread.start()
    yield answers
    is_over.set()
    if wanted:
        thread.join()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0, help="how long a line is noisy in one round")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    worst = 0.0
    print("| line | answers/s | of a core |\n|---|---:|---:|", flush=True)
    for kind in KINDS:
        share, answers = min(measured(kind, options.seconds) for _ in range(options.rounds))
        worst = max(worst, share)
        print(f"| {kind.name} | {answers:.0f} | {share:.3f} |", flush=True)
    return int(worst > GOAL)


if __name__ == "__main__":
    raise SystemExit(main())
