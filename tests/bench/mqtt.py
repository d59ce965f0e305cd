"""1000 points of 8 lines, read and published once a second: the lines' share, CPU time and memory of the gateway.

    .venv/bin/python tests/bench/mqtt.py [--seconds 60]

Simulated devices that take the time of their wire, on virtual ports, and mosquitto. The share of a line is compared
with the forecast of `check`, to which the answer times of the devices are added: their profile does not name them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import mean

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.config.line_load import load_of, total_share
from gateway.config.load import parse
from gateway.config.resolve import resolve
from kit.mosquitto import Mosquitto, Subscriber
from kit.process import COMMAND, GatewayProcess, simulated

LINES, DEVICES, POINTS = 8, 5, 25
BAUD = 115200
#: After which time these devices answer, in seconds.
ANSWER_TIME = 0.005

PROFILE = f"""
[profile.meter]
points = [{{ name = "value-*", holding = "0-{POINTS - 1}" }}]
"""


def config(folder: Path, broker: int) -> str:
    """The config with its lines, and the broker at this port."""
    text = f'site = "bench"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n[control]\nsocket = "{folder}/control.sock"\n'
    for line in range(LINES):
        first = line * DEVICES + 1
        units = f'unit = "1-{DEVICES}", as = "{first}-{first + DEVICES - 1}"'
        devices = f'{{ {units}, name = "meter-*", profile = "meter" }}'
        text += f'[[line]]\nname = "line-{line}"\nport = "{folder}/line-{line}"\nbaud = {BAUD}\ndevices = [{devices}]\n'
    row = '{ device = "meter-*", every = "1 s", at_least = "1 s" }'
    return f'{text}{PROFILE}[mqtt]\nbroker = "mqtt://127.0.0.1:{broker}"\npublish = [{row}]\n'


def status(folder: Path) -> dict:
    """What the gateway tells of itself."""
    words = [*COMMAND, "status", "--json", "--control", str(folder / "control.sock")]
    return json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def cpu(pid: int) -> float:
    """The seconds of CPU time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(folder: Path, seconds: float) -> None:
    """Run it, and print."""
    with ExitStack() as stack:
        broker = stack.enter_context(Mosquitto(folder))
        for line in range(LINES):
            stack.enter_context(simulated(folder / f"line-{line}", f"generic:1-{DEVICES}", "--baud", str(BAUD)))
        gateway = stack.enter_context(GatewayProcess(folder, config(folder, broker.port), level="info"))
        gateway.wait_for("broker_up")
        subscriber = stack.enter_context(Subscriber(broker, "modbus/bench/+"))
        time.sleep(5.0)
        before, began, used, heard = status(folder), time.monotonic(), cpu(gateway.pid), len(subscriber.heard)
        time.sleep(seconds)
        after, took = status(folder), time.monotonic() - began
        used, heard = cpu(gateway.pid) - used, len(subscriber.heard) - heard
        shares = [
            (late["busy_s"] - early["busy_s"]) / took
            for early, late in zip(before["lines"], after["lines"], strict=True)
        ]
        plan = resolve(parse(config(folder, 1883), port_trouble=lambda _: None, real_path=str).config)
        foretold = total_share(load_of(plan.lines[0], plan)) + DEVICES * ANSWER_TIME
        polls = after["brokers"][0]["polls"] - before["brokers"][0]["polls"]
        failed = after["brokers"][0]["failed_polls"] - before["brokers"][0]["failed_polls"]
        print(f"{LINES * DEVICES * POINTS} points on {LINES} lines, {took:.0f} s")
        print(f"reads      {polls / took:.1f} a second ({failed} failed), {LINES * DEVICES} are asked for")
        print(f"messages   {heard / took:.1f} a second reach a subscriber")
        print(f"line share {mean(shares):.1%} (from {min(shares):.1%} to {max(shares):.1%}), foretold {foretold:.1%}")
        print(f"CPU        {used / took:.1%} of one core")
        print(f"memory     {gateway.memory(most=True) / 1024:.0f} MiB")


def main() -> None:
    """Measure once."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), args.seconds)


if __name__ == "__main__":
    main()
