"""1000 points of 8 lines, read and published once a second: the lines' share, CPU time and memory of the gateway.

    .venv/bin/python tests/bench/mqtt.py [--seconds 20] [--lines 8]

Simulated devices that take the time of their wire, on virtual ports, and mosquitto, which is killed and started again.
The share of a line is compared with the forecast of `check`, to which the answer times of the devices are added: their
profile does not name them. What is more than foretold is in `wait`, if anywhere: the kernel takes some tenths of a
millisecond to hand bytes over between virtual ports, and on two cores the devices wait for one another.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import mean
from typing import NamedTuple, Self

from used import cpu

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.config.load import parse
from gateway.config.plan.line_load import load_of, total_share
from gateway.config.resolve import resolve
from gateway.modbus.pdu import parse_request
from kit.mosquitto import Mosquitto, Subscriber
from kit.process import COMMAND, GatewayProcess, simulated

DEVICES, POINTS = 5, 25
BAUD = 115200
#: After which time these devices answer, in seconds.
ANSWER_TIME = 0.005

PROFILE = f"""
[profile.meter]
points = [{{ name = "value-*", holding = "0-{POINTS - 1}" }}]
"""


def config(folder: Path, broker: int, lines: int) -> str:
    """The config with so many lines, and the broker at this port."""
    text = f'site = "bench"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n[control]\nsocket = "{folder}/control.sock"\n'
    for line in range(lines):
        first = line * DEVICES + 1
        units = f'unit = "1-{DEVICES}", as = "{first}-{first + DEVICES - 1}"'
        devices = f'{{ {units}, name = "meter-*", profile = "meter" }}'
        text += f'[[line]]\nname = "line-{line}"\nport = "{folder}/line-{line}"\nbaud = {BAUD}\ndevices = [{devices}]\n'
    row = '{ device = "meter-*", every = "1 s", at_least = "1 s" }'
    return f'{text}{PROFILE}[mqtt]\nbroker = "mqtt://127.0.0.1:{broker}"\npublish = [{row}]\n'


class Reading(NamedTuple):
    """What counts up: at what time, by the gateway's own status, its CPU time, and messages at a subscriber."""

    at: float
    status: dict
    cpu: float
    heard: int


class Bench:
    """Eight lines, a broker, a gateway and a subscriber, in its context."""

    def __init__(self, folder: Path, lines: int) -> None:
        self._folder = folder
        self._lines = lines

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        self.broker = self._stack.enter_context(Mosquitto(self._folder))
        for line in range(self._lines):
            words = f"generic:1-{DEVICES}", "--baud", str(BAUD)
            self._stack.enter_context(simulated(self._folder / f"line-{line}", *words))
        text = config(self._folder, self.broker.port, self._lines)
        self.gateway = self._stack.enter_context(GatewayProcess(self._folder, text, level="info"))
        self.gateway.wait_for("broker_up")
        self._subscriber = self._stack.enter_context(Subscriber(self.broker, "modbus/bench/+"))
        time.sleep(5.0)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def read(self) -> Reading:
        """How everything stands."""
        words = [*COMMAND, "status", "--json", "--control", str(self._folder / "control.sock")]
        told = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
        return Reading(time.monotonic(), told, cpu(self.gateway.pid), len(self._subscriber.heard))

    def during(self, seconds: float) -> tuple[Reading, Reading]:
        """How it stood before and after this time."""
        before = self.read()
        time.sleep(seconds)
        return before, self.read()


def share_of(before: Reading, after: Reading) -> list[float]:
    """The share of its time that each line was busy."""
    pairs = zip(before.status["lines"], after.status["lines"], strict=True)
    return [(late["busy_s"] - early["busy_s"]) / (after.at - before.at) for early, late in pairs]


def phases_of(before: Reading, after: Reading) -> dict[str, float]:
    """The seconds of a read, by what they were spent on."""
    reads = after.status["brokers"][0]["polls"] - before.status["brokers"][0]["polls"]
    lines = list(zip(before.status["lines"], after.status["lines"], strict=True))
    return {
        phase: sum(late["phases"][phase] - early["phases"][phase] for early, late in lines) / reads
        for phase in ("request", "wait", "response", "gap")
    }


def foretold(lines: int) -> tuple[float, dict[str, float]]:
    """The share of a line, and the seconds of a read, by the forecast of `check` and the time of the devices."""
    plan = resolve(parse(config(Path("/dev"), 1883, lines), port_trouble=lambda _: None, real_path=str).config)
    line = plan.lines[0]
    timing, (poll, *_) = line.line.timing, load_of(line, plan)
    asked = parse_request(poll.declared.poll.request)
    end = timing.silence(poll.declared.of.profile.idle_chars)
    phases = {
        "request": timing.frame(len(asked.data)),
        "wait": end + ANSWER_TIME,
        "response": timing.frame(asked.longest_response),
        "gap": line.line.silence_before_request,
    }
    return total_share(load_of(line, plan)) + DEVICES * ANSWER_TIME, phases


def measure(folder: Path, seconds: float, lines: int) -> None:
    """Run it, and print."""
    share, phases = foretold(lines)
    with Bench(folder, lines) as bench:
        before, after = bench.during(seconds)
        bench.broker.kill()
        bench.gateway.wait_for("broker_lost")
        away = mean(share_of(*bench.during(seconds)))
        bench.broker.start()
        bench.gateway.wait_for("broker_up")
        back = mean(share_of(*bench.during(seconds)))
        memory = bench.gateway.memory(most=True) / 1024
    took = after.at - before.at
    counts = [each.status["brokers"][0] for each in (before, after)]
    polls, failed = (counts[1][name] - counts[0][name] for name in ("polls", "failed_polls"))
    shares = share_of(before, after)
    print(f"{lines * DEVICES * POINTS} points on {lines} lines, {took:.0f} s")
    print(f"reads      {polls / took:.1f} a second ({failed} failed), {lines * DEVICES} are asked for")
    print(f"messages   {(after.heard - before.heard) / took:.1f} a second reach a subscriber")
    print(f"line share {mean(shares):.1%} (from {min(shares):.1%} to {max(shares):.1%}), foretold {share:.1%}")
    print(f"           {away:.1%} while the broker is away, {back:.1%} when it is back")
    for phase, each in phases_of(before, after).items():
        print(f"  {phase:<8} {1000 * each:.2f} ms a read, foretold {1000 * phases[phase]:.2f}")
    print(f"CPU        {(after.cpu - before.cpu) / took:.1%} of one core")
    print(f"memory     {memory:.0f} MiB")


def main() -> None:
    """Measure once."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="for each of three parts: the broker is killed, and back"
    )
    parser.add_argument("--lines", type=int, default=8)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), args.seconds, args.lines)


if __name__ == "__main__":
    main()
