"""The broker is away for ten minutes at 1000 values a second on 8 lines: what comes of them, and what it costs.

    .venv/bin/python tests/bench/outage.py --minutes 10

Simulated devices at the pace of their lines; all of their values change with each read, and one of them is the time of
that read. A gateway with `keep` publishes them to mosquitto, which is killed, and started again after these minutes. A
subscriber is there whenever the broker is. Values are judged when all was sent: each must have come once, in order and
with its time. The share of the lines, processor time, memory and what is written to the disk (see flash.py) are told
for each part: before, while the broker is away, while history is sent, and after. `--real-time` lets devices and
gateway go before everything else on a busy machine; that needs root.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from signal import SIGKILL
from statistics import mean, quantiles
from typing import Any, NamedTuple

import programs
from used import cpu, go_first, resident

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.config.load import parse
from gateway.config.plan.line_load import load_of, total_share
from gateway.config.resolve import resolve
from kit.process import COMMAND, GatewayProcess
from soak.kept_messages import SITE, Heard, told_by
from soak.kept_record import Told
from soak.kept_tap import Packet
from soak.kept_world import Loop, PlantBroker

LINES, DEVICES = 8, 5
#: The first four registers are one point, the time of the read; the others are one each.
STAMP, COUNTS = 4, 24
BAUD = 115200
#: After which time these devices answer, in seconds.
ANSWER_TIME = 0.005
#: How long it is measured before the broker is away, and after everything was sent, in seconds.
AROUND = 60.0
SAMPLE = 5.0
#: All history was sent when none has come for so long, in seconds.
QUIET = 15.0
KEEP_EVERY = 10
POINTS = f"""
[profile.meter]
points = [
  {{ name = "stamp", holding = 0, type = "uint64" }},
  {{ name = "count-*", holding = "{STAMP}-{STAMP + COUNTS - 1}" }},
]
"""


def config(folder: Path, broker: int, keep: str) -> str:
    """The config with the broker at this port."""
    text = f'site = "{SITE}"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n[control]\nsocket = "{folder}/control.sock"\n'
    for line in range(LINES):
        first = line * DEVICES + 1
        units = f'unit = "1-{DEVICES}", as = "{first}-{first + DEVICES - 1}"'
        devices = f'{{ {units}, name = "meter-*", profile = "meter" }}'
        text += f'[[line]]\nname = "line-{line}"\nport = "{folder}/line-{line}"\nbaud = {BAUD}\ndevices = [{devices}]\n'
    mqtt = f'[mqtt]\nbroker = "mqtt://127.0.0.1:{broker}"\npublish = [{{ device = "meter-*", every = "1 s" }}]\n'
    return f"{text}{POINTS}{mqtt}{keep}\n"


def foretold(keep: str) -> float:
    """The share of a line, by the forecast of `check` and the time of the devices."""
    plan = resolve(parse(config(Path("/dev"), 1883, keep), port_trouble=lambda _: None, real_path=str).config)
    return total_share(load_of(plan.lines[0], plan)) + DEVICES * ANSWER_TIME


class Sample(NamedTuple):
    """What counts up, and what is used: seconds, KiB, bytes."""

    at: float
    cpu: float
    memory: int
    written: int
    busy: tuple[float, ...]
    polls: int
    failed: int
    kept: Any


class Bench:
    """Lines, a broker, a subscriber and a gateway."""

    def __init__(self, folder: Path, stack: ExitStack, seconds: float, keep: str) -> None:
        self._folder = folder
        programs.compile_into(folder)
        words = [folder / "devices", "--stamp", "--count", "--units", f"1-{DEVICES}", "--baud", BAUD, "--bits", 10]
        words += ["--delay", f"0:{ANSWER_TIME * 1e6:.0f}", "--seconds", int(seconds)]
        for line in range(LINES):
            words += ["--link", folder / f"line-{line}"]
        devices = programs.start([*map(str, words)], programs.processors()[0], stdout=subprocess.DEVNULL)
        stack.callback(programs.end, devices)
        self.plant = PlantBroker(folder, stack.enter_context(Loop()))
        self.plant.start()
        stack.callback(self.plant.stop)
        text = config(folder, self.plant.tap.port, keep)
        self.gateway = stack.enter_context(GatewayProcess(folder, text, level="info"))
        self.gateway.wait_for("broker_up")
        self._devices = devices.pid

    def go_first(self) -> None:
        """Let the devices and the gateway go before everything else on this machine."""
        go_first((self._devices, self.gateway.pid))

    def sample(self) -> Sample:
        """How it stands."""
        pid = self.gateway.pid
        written = int(Path(f"/proc/{pid}/io").read_text().split("\nwrite_bytes: ")[1].split()[0])
        words = [*COMMAND, "status", "--json", "--control", str(self._folder / "control.sock")]
        told = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
        busy = tuple(line["busy_s"] for line in told["lines"])
        broker = told["brokers"][0]
        return Sample(
            time.monotonic(),
            cpu(pid),
            resident(pid),
            written,
            busy,
            broker["polls"],
            broker["failed_polls"],
            broker.get("kept"),
        )

    def during(self, seconds: float) -> list[Sample]:
        """Samples of this time."""
        ends = time.monotonic() + seconds
        samples = [self.sample()]
        while (left := ends - time.monotonic()) > 0:
            time.sleep(min(SAMPLE, left))
            samples.append(self.sample())
        return samples

    def until_sent(self) -> list[Sample]:
        """Samples until no history comes any more."""
        samples, last, known = [self.sample()], time.monotonic(), 0
        while time.monotonic() - last < QUIET:
            time.sleep(1.0)
            heard = self.plant.consumer.heard
            if any(each.topic.endswith("/history") for each in heard[known:]):
                last = time.monotonic()
            known = len(heard)
            if time.monotonic() - samples[-1].at > SAMPLE:
                samples.append(self.sample())
        return samples


def tell(name: str, samples: Sequence[Sample]) -> None:
    """Print what a part has cost."""
    first, last = samples[0], samples[-1]
    took = last.at - first.at
    shares = [(late - early) / took for early, late in zip(first.busy, last.busy, strict=True)]
    memory = [sample.memory / 1024 for sample in samples]
    written = (last.written - first.written) / 2**20
    reads = f"{(last.polls - first.polls) / took:.1f} reads/s, {last.failed - first.failed} failed"
    print(
        f"{name:12} {took:6.0f} s | line share {mean(shares):.2%} ({min(shares):.2%} to {max(shares):.2%}) | "
        f"{reads} | CPU {(last.cpu - first.cpu) / took:.1%} | "
        f"RSS {memory[0]:.1f} to {memory[-1]:.1f} MiB, most {max(memory):.1f} | "
        f"written {written:.1f} MiB, {written * 3600 / took:.0f} MiB/h | kept {last.kept}",
        flush=True,
    )


def parsed(messages: Sequence[Heard | Packet]) -> Iterator[Told]:
    """Those with values of devices."""
    return (told for told in (told_by(each, is_sparkplug=False) for each in messages) if told is not None)


def judge(heard: Sequence[Told], ahead: float) -> int:
    """Print what came; how many faults there are. `ahead` is how far Unix times are ahead of the devices' clock."""
    live: dict[str, list[int]] = defaultdict(list)
    history: dict[str, list[int]] = defaultdict(list)
    lags, mixed = [], 0
    for told in heard:
        for entry in told.entries:
            counts = {value for name, value in entry.values.items() if name != "stamp"}
            (history if told.is_history else live)[told.device].append(max(counts))
            mixed += len(counts) > 1 or len(entry.values) != COUNTS + 1
            lags.append(entry.at - ahead - entry.values["stamp"] / 1e9)
    lost = doubled = disordered = 0
    for device, own in live.items():
        kept = history[device]
        came = {*own, *kept}
        # A birth tells the latest again: that is no double.
        lost += max(came) - min(came) + 1 - len(came)
        doubled += len(kept) - len({*kept}) + len({*own} & {*kept})
        disordered += sum(one >= other for one, other in pairwise(kept))
        disordered += sum(one > other for one, other in pairwise(own))
    values = sum(map(len, history.values())) * (COUNTS + 1)
    percentiles = quantiles(lags, n=1000)
    print(f"{len(live)} devices, {sum(map(len, live.values()))} live messages, {values} values of history")
    print(f"readings: {lost} lost, {doubled} twice, {disordered} out of order, {mixed} mixed")
    print(
        f"their time after the request: p50 {1000 * percentiles[499]:.1f} ms, p99.9 {1000 * percentiles[998]:.1f} ms,"
    )
    print(f"  from {1000 * min(lags):.1f} to {1000 * max(lags):.1f} ms")
    return lost + doubled + disordered + mixed


def ages(sent: Sequence[Told], ahead: float, begin: float, end: float) -> str:
    """How old live values were when they were sent, between these Unix times."""
    found = [
        told.at - ahead - told.entries[0].values["stamp"] / 1e9
        for told in sent
        if not told.is_history and begin <= told.at <= end and told.entries[0].values.get("stamp")
    ]
    return f"mean {1000 * mean(found):.0f} ms, most {1000 * max(found):.0f} ms" if found else "none"


@contextmanager
def bench(minutes: float, keep: str) -> Iterator[Bench]:
    """All that it needs, on a real disk."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="outage.", dir="/var/tmp")))
        yield Bench(folder, stack, 60 * minutes + 3600, keep)


def measure(minutes: float, keep: str, *, real_time: bool) -> int:
    """Run it, and print; how many faults there are."""
    print(f"{LINES * DEVICES * (COUNTS + 1)} points on {LINES} lines, each read and changed once a second; {keep!r}")
    print(f"foretold: line share {foretold(keep):.2%}; load of the machine {os.getloadavg()[0]:.1f}")
    with bench(minutes, keep) as stage:
        if real_time:
            stage.go_first()
        time.sleep(5.0)
        tell("before", stage.during(AROUND))
        stage.plant.end(SIGKILL)
        tell("away", away := stage.during(60 * minutes))
        for sample in away[:: max(1, len(away) // 10)]:
            print(f"  {sample.at - away[0].at:5.0f} s: {sample.memory / 1024:.1f} MiB, kept {sample.kept}")
        stage.plant.start()
        back = time.time()
        tell("sending", stage.until_sent())
        tell("after", stage.during(AROUND))
        ahead = max(time.time() - time.monotonic() for _ in range(100))  # who waits in between sees less
        packets, heard = [*stage.plant.tap.packets], [*stage.plant.consumer.heard]
        print(f"load of the machine {os.getloadavg()[0]:.1f}")
    sent = [*parsed(packets)]
    history = [told for told in sent if told.is_history]
    faults = judge([*parsed(heard)], ahead)
    if history:
        took, size = (
            history[-1].at - back,
            max(len(each.payload) for each in packets if each.topic.endswith("/history")),
        )
        rate = len(history) / max(1e-9, history[-1].at - history[0].at)
        print(f"all sent {took:.1f} s after the return: {len(history)} messages, {rate:.1f}/s, at most {size} bytes")
        print(f"age of live values meanwhile: {ages(sent, ahead, history[0].at, history[-1].at)};")
        print(f"  before: {ages(sent, ahead, 0.0, back - 60 * minutes)}")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="how long the broker is away")
    parser.add_argument("--no-keep", action="store_true", help="for comparison")
    parser.add_argument("--real-time", action="store_true", help="devices and gateway go first on a busy machine")
    args = parser.parse_args()
    keep = "" if args.no_keep else f'keep = "64 MiB"\nkeep_every = "{KEEP_EVERY} s"'
    return 1 if measure(args.minutes, keep, real_time=args.real_time) else 0


if __name__ == "__main__":
    sys.exit(main())
