"""A long run: three lines, every kind of device, sixteen clients; each answer is checked.

    .venv/bin/python tests/soak/devices.py --minutes 10

Ends with status 0 if every question was answered, and rightly. Simulators and gateway are processes of their own.
"""

import argparse
import asyncio
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.modbus import mbap
from kit.process import COMMAND, GatewayProcess

CLIENTS = 16
#: Longer than a request can wait for its turn behind all others, in seconds.
PATIENCE = 20.0

SIMULATORS = {
    "scales": ("weigher:1-2", "--weight", "4999.66"),
    "plc": ("v80:6,17",),
    "motion": ("mint:2-3", "--mode", "ascii"),
}

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "scales"
port = "{folder}/scales"
baud = 9600
max_wait = "10 s"
devices = [{{ unit = "1-2", as = "41-42", profile = "weigher" }}]

[[line]]
name = "plc"
port = "{folder}/plc"
baud = 19200
max_wait = "10 s"
devices = [{{ unit = 6, as = 46, profile = "v80" }}, {{ unit = 17, as = 57, profile = "v80" }}]

[[line]]
name = "motion"
port = "{folder}/motion"
mode = "ascii"
baud = 19200
latency = "250 ms"   # simulators and gateway share this machine with whatever else runs
max_wait = "10 s"
devices = [{{ unit = "2-3", as = "52-53", profile = "mint" }}]

[[image]]
unit = 200
holding = 100
"""


@dataclass(frozen=True)
class Question:
    """A request whose answer is known, whoever else asks."""

    unit: int
    request: str
    answer: str


WEIGHT = Question(41, "03 0000 0002", "03 04 459C3D51")
QUESTIONS = [
    WEIGHT,
    Question(42, WEIGHT.request, WEIGHT.answer),
    Question(41, "03 0010 0001", "03 02 0001"),
    Question(42, "03 0010 0001", "03 02 0002"),
    Question(41, "04 0000 0001", "84 01"),
    Question(46, "03 006B 0003", "03 06 006300630063"),
    Question(57, "03 006B 0003", "03 06 022B00000064"),
    Question(57, "01 0013 0025", "01 05 CD6BB20E1B"),
    Question(57, "05 00AC FF00", "05 00AC FF00"),
    Question(57, "06 0087 039E", "06 0087 039E"),
    Question(46, "01 0000 0401", "81 03"),
    Question(52, "03 0000 0001", "83 02"),
    Question(52, "05 0003 FF00", "05 0003 FF00"),
    Question(53, "10 0001 0002 04 12345678", "10 0001 0002"),
    Question(53, "17 0005 0001 0005 0001 02 BEEF", "17 02 BEEF"),
    Question(200, "06 0005 0007", "06 0005 0007"),
    Question(200, "03 0005 0001", "03 02 0007"),
    Question(99, "03 0000 0001", "83 0A"),
]


class Tally:
    """What came of the questions."""

    def __init__(self) -> None:
        self.right: Counter[int] = Counter()
        self.wrong: list[str] = []
        self.slowest = 0.0

    def __str__(self) -> str:
        by_unit = ", ".join(f"{unit}: {count}" for unit, count in sorted(self.right.items()))
        return (
            f"{self.right.total()} right answers ({by_unit}); slowest {1000 * self.slowest:.0f} ms;"
            f" {len(self.wrong)} wrong or missing"
        )


async def client(port: int, number: int, end: float, tally: Tally) -> None:
    """Ask one question after the other."""
    chance = random.Random(number)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    transaction = 0
    while time.monotonic() < end:
        question = chance.choice(QUESTIONS)
        transaction = (transaction + 1) & 0xFFFF
        begin = time.monotonic()
        writer.write(mbap.encode(transaction, question.unit, bytes.fromhex(question.request)))
        expected = mbap.encode(transaction, question.unit, bytes.fromhex(question.answer))
        try:
            async with asyncio.timeout(PATIENCE):
                header = await reader.readexactly(6)
                answer = header + await reader.readexactly(int.from_bytes(header[4:]))
        except TimeoutError:
            tally.wrong.append(f"client {number}: {question}: no answer")
            return
        tally.slowest = max(tally.slowest, time.monotonic() - begin)
        if answer == expected:
            tally.right[question.unit] += 1
        else:
            tally.wrong.append(f"client {number}: {question}: {answer.hex(' ')}")
    writer.close()


async def load(port: int, seconds: float) -> Tally:
    """All clients at once; a line of progress each minute."""
    tally = Tally()
    end = time.monotonic() + seconds
    clients = [asyncio.create_task(client(port, number, end, tally)) for number in range(CLIENTS)]
    while not all(task.done() for task in clients):
        await asyncio.wait(clients, timeout=60)
        print(f"{max(0.0, end - time.monotonic()):5.0f} s to go: {tally}", flush=True)
    await asyncio.gather(*clients)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    minutes = parser.parse_args().minutes
    with ExitStack() as running:
        folder = Path(running.enter_context(tempfile.TemporaryDirectory()))
        for name, words in SIMULATORS.items():
            simulate = [*COMMAND, "simulate", *words, "--port", str(folder / name)]
            process = running.enter_context(subprocess.Popen(simulate, stdout=subprocess.PIPE, text=True))
            running.callback(process.terminate)
            assert process.stdout is not None
            process.stdout.readline()
        gateway = running.enter_context(GatewayProcess(folder, CONFIG.format(folder=folder)))
        tally = asyncio.run(load(gateway.port, 60 * minutes))
        failures = [event for event in gateway.log if event["level"] in {"warning", "error"}]
    print(*tally.wrong[:20], *failures[:20], sep="\n")
    print(tally)
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
