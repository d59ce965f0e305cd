"""Bad clients beside a good one: it must hardly notice them.

    .venv/bin/python tests/soak/clients.py
    .venv/bin/python tests/soak/clients.py --attack "malformed flood" --rounds 9

Each attack has a gateway of its own. A healthy client polls a device: undisturbed, while a second gateway is attacked,
and while its own is. The second one shows what the attack costs on this machine though nobody shares a gateway with the
attacker. Client, attacker, gateways and device are processes of their own. Ends with status 0 if each attack left the
promises whole: the median of the healthy client's p99 at most 1.5 times the larger of the two others, and every answer
right; memory bounded, no descriptor left open, no traceback, and a log that repeats itself as little as it should. On a
busy machine more rounds help.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from math import inf
from multiprocessing import get_context
from pathlib import Path
from statistics import median, quantiles

sys.path.insert(0, str(Path(__file__).parents[1]))

from bad_clients import ATTACKS, IMAGE, attack, connect, read, receive

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

#: What is promised: how much slower a healthy client's slowest hundredth may become.
MOST_SLOWER = 1.5
#: How much memory an attack may cost, in KiB, and what it costs after it has ended.
MOST_KIB = {"half-open": 500 * 20, "connections": 64 * 1024, "slow reader": 1024}
MOST_KIB_ELSEWHERE = 5 * 1024
#: Lines of log about one thing in so many seconds; about clients of one address that are sent away, one and a count.
MOST_LINES, MOST_LINES_SENT_AWAY = (10, 1.0), (2, 10.0)
#: An attack that needs more than a moment to show what becomes of it, in seconds.
LASTS = {"half-open": 12.0, "slow reader": 35.0}
#: How long an attack may take to get going, and the gateway to forget it, in seconds.
START, END = 2.0, 10.0

CONFIG = f"""
[[listen]]
bind = "tcp://127.0.0.1:0"
clients = {{clients}}

[[line]]
name = "hall-a"
port = "{{port}}"
devices = [{{{{ unit = 1 }}}}]

[[image]]
unit = {IMAGE}
holding = 125
"""
#: Room for every half-open client; the flood of connections finds less.
CLIENTS = {"connections": 256}
CLIENTS_ELSEWHERE = 600

#: What the healthy client reads: one register with the value 42.
ANSWER = bytes.fromhex("0001 0000 0005 01 03 02 002A")

PROCESSES = get_context("spawn")


@dataclass
class Findings:
    """What came of one attack; times in milliseconds, memory in KiB."""

    name: str
    calm: list[float] = field(default_factory=list)
    elsewhere: list[float] = field(default_factory=list)
    attacked: list[float] = field(default_factory=list)
    deeds: int = 0
    wrong: list[str] = field(default_factory=list)
    grown: int = 0
    descriptors: int = 0
    tracebacks: list[str] = field(default_factory=list)
    lines: int = 0
    repeated: list[str] = field(default_factory=list)

    @property
    def ratio(self) -> float:
        return median(self.attacked) / max(median(self.calm), median(self.elsewhere))

    @property
    def broken(self) -> list[str]:
        """The promises that were not kept."""
        promises = {
            "p99": self.ratio <= MOST_SLOWER,
            "answers": not self.wrong,
            "memory": self.grown <= MOST_KIB.get(self.name, MOST_KIB_ELSEWHERE),
            "descriptors": self.descriptors <= 0,
            "tracebacks": not self.tracebacks,
            "log": not self.repeated,
            "no attack": self.deeds > 0,
        }
        return [name for name, kept in promises.items() if not kept]

    def __str__(self) -> str:
        return (
            f"{self.name:16}{self.deeds:>10}{median(self.calm):>10.2f}{median(self.elsewhere):>11.2f}"
            f"{median(self.attacked):>10.2f}{self.ratio:>7.2f}"
            f"{self.grown:>9}{self.descriptors:>6}{len(self.tracebacks):>8}{self.lines:>7}"
            f"  {', '.join(self.broken) or '-'}"
        )


HEAD = (
    f"{'attack':16}{'done':>10}{'p99 calm':>10}{'elsewhere':>11}{'attacked':>10}{'ratio':>7}"
    f"{'KiB more':>9}{'fds':>6}{'traces':>8}{'lines':>7}  broken promises"
)


def healthy(port: int, seconds: float) -> tuple[float, list[str]]:
    """Ask one thing after the other; the p99 in milliseconds, and what was not the answer."""
    times, wrong, end = [], [], time.monotonic() + seconds
    with connect(port) as client:
        while (begin := time.monotonic()) < end:
            try:
                client.sendall(read(1, 1))
                answer = receive(client, len(ANSWER))
            except OSError as error:
                return inf, [*wrong, f"after {len(times)} answers: {error!r}"]
            times.append(1000 * (time.monotonic() - begin))
            if answer != ANSWER:
                wrong.append(answer.hex(" "))
            time.sleep(0.005)
    return quantiles(times, n=100)[98], wrong


@contextmanager
def attacked(name: str, port: int, findings: Findings) -> Iterator[None]:
    """In its context the attack is under way."""
    stop, deeds = PROCESSES.Event(), PROCESSES.Value("q", 0)
    attacker = PROCESSES.Process(target=attack, args=(name, port, stop, deeds))
    attacker.start()
    try:
        time.sleep(START)
        yield
    finally:
        stop.set()
        attacker.join()
        findings.deeds += deeds.value
        if attacker.exitcode:
            findings.wrong.append(f"the attacker ended with status {attacker.exitcode}")


def examine(name: str, gateway: GatewayProcess, other: GatewayProcess, seconds: float, rounds: int) -> Findings:
    """Undisturbed, `other` attacked, `gateway` attacked, in turn, because machines have moods."""
    findings = Findings(name)
    with ProcessPoolExecutor(1, PROCESSES) as client:

        def poll(times: list[float], seconds: float) -> None:
            p99, wrong = client.submit(healthy, gateway.port, seconds).result()
            times.append(p99)
            findings.wrong += wrong

        descriptors, memory = gateway.descriptors, 0
        for _ in range(rounds):
            poll(findings.calm, seconds)
            with attacked(name, other.port, Findings(name)):
                poll(findings.elsewhere, seconds)
            memory = memory or gateway.memory()
            with attacked(name, gateway.port, findings):
                poll(findings.attacked, max(seconds, LASTS.get(name, 0.0)))
    findings.grown = gateway.memory(most=True) - memory
    findings.descriptors = _left_over(gateway, descriptors)
    return findings


def _left_over(gateway: GatewayProcess, before: int) -> int:
    """Descriptors that the gateway still has when it had time to close them."""
    end = time.monotonic() + END
    while (more := gateway.descriptors - before) > 0 and time.monotonic() < end:
        time.sleep(0.1)
    return more


def read_log(gateway: GatewayProcess, findings: Findings) -> Counter[str]:
    """Look for errors and repetitions; why clients were sent away, and how often that was said."""
    subjects: dict[tuple[str, ...], list[float]] = {}
    for event in gateway.log:
        client = str(event.get("client")).rpartition(":")[0] or event.get("client")
        subject = (event["event"], event["level"], client, *(event.get(key) for key in ("line", "unit", "problem")))
        subjects.setdefault(subject, []).append(datetime.fromisoformat(event["timestamp"]).timestamp())
    findings.lines = len(gateway.log)
    findings.repeated = [
        f"too many lines: {subject}" for subject, times in subjects.items() if _repeats(subject, times)
    ]
    errors = [str(event) for event in gateway.log if event["level"] in {"error", "critical"}]
    findings.tracebacks = errors + gateway.rest
    return Counter(event.get("reason", "suppressed") for event in gateway.log if event["event"] == "client_rejected")


def _repeats(subject: tuple[str, ...], times: list[float]) -> bool:
    most, seconds = MOST_LINES_SENT_AWAY if subject[0] == "client_rejected" else MOST_LINES
    return any(sum(0 <= each - first < 0.99 * seconds for each in times) > most for first in times)


def run(name: str, seconds: float, rounds: int) -> Findings:
    """One attack on a gateway of its own."""
    device = SimulatedDevice(1, delay=0.002)
    device.holding[0] = 42
    with ExitStack() as running:
        folders = [Path(running.enter_context(tempfile.TemporaryDirectory())) for _ in range(2)]
        ports = [running.enter_context(VirtualPort(folder / "hall-a")) for folder in folders]
        running.enter_context(SerialDevices({ports[0]: SimulatedLine("rtu", device)}))
        configs = [CONFIG.format(port=port.path, clients=CLIENTS.get(name, CLIENTS_ELSEWHERE)) for port in ports]
        gateways = [GatewayProcess(*each, level="info") for each in zip(folders, configs, strict=True)]
        gateway, other = (running.enter_context(each) for each in gateways)
        findings = examine(name, gateway, other, seconds, rounds)
        reasons = read_log(gateway, findings)
    notes = [f"{reason}: {count} lines" for reason, count in reasons.items()]
    notes += [f"! {each}" for each in (findings.wrong + findings.tracebacks + findings.repeated)[:10]]
    print(findings, *notes, sep="\n    ", flush=True)
    return findings


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attack", action="append", choices=ATTACKS, help="only this one; may be repeated")
    parser.add_argument("--seconds", type=float, default=8.0, help="for each measurement")
    parser.add_argument("--rounds", type=int, default=3, help="of an undisturbed and an attacked measurement")
    args = parser.parse_args()
    print(HEAD)
    findings = [run(name, args.seconds, args.rounds) for name in args.attack or ATTACKS]
    if "port scan" not in ATTACKS:
        print("port scan: left out, nmap is not installed (Debian package nmap)")
    return 1 if any(each.broken for each in findings) else 0


if __name__ == "__main__":
    sys.exit(main())
