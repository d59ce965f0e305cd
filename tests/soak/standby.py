"""Two gateways with one lease on one bus, and faults by chance: never two askers at once, never a wrong answer.

    .venv/bin/python tests/soak/standby.py --rounds 500
    .venv/bin/python tests/soak/standby.py --rounds 500 --server

Each round has one fault: the holder or the standby is killed, or stopped and continued; the holder's wall clock is set;
NATS is killed, halted or away for a while, or comes back with an older store; the link between one of them and NATS is
cut, or held and then passes on all that it has held. With `--server` the bus hangs on a device server with a port for
each gateway, otherwise on two serial adapters. A monitor on the bus sees who has sent each frame. Devices are late now
and then, within the late window.

Prints how often two askers were on the wire at once, or nearer than any change of the holder can be; how often that was
a gateway that had just been continued, which may have been stopped between its look at the clock and its write; how
many answers were wrong; and the longest gap in service after each fault. Ends with status 0 if no askers met otherwise,
and no answer was wrong.
"""

import argparse
import json
import mmap
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gateway.modbus import mbap
from kit.link import Link
from kit.nats import NatsServer
from kit.process import GatewayProcess, command
from kit.shared_bus import REGISTERS, UNITS, Bus, Collision, sometimes_late

#: The time to live of the lease, in seconds; behind a device server, where TCP may hold back what was written.
TTL, TTL_BEHIND_SERVER = 2.0, 3.0
#: The longest time that a fault lasts, in leases.
LONGEST_FAULT = 1.5
#: After a gap of so many leases the logs are told.
WORTH_TELLING = 2.5
#: How soon after it was continued a gateway may write what it had decided before it was stopped, in seconds.
JUST_CONTINUED = 0.05
#: How long nobody may answer after a fault is over, in seconds.
PATIENCE = 60.0
#: How long a client waits before it asks again, on average, in seconds.
PAUSE = 0.005
#: NATS comes back with what it held when that was kept.
OLDER_STORE = "NATS comes back older"
CONFIG = """
site = "{name}"
[[listen]]
bind = "tcp://127.0.0.1:0"
[fleet]
servers = ["nats://127.0.0.1:{nats}"]
lease = "{ttl:g} s"
[[line]]
name = "bus"
port = "{port}"
baud = 115200
timeout = "150 ms"
lease = "hall-a"
"""


class Site:
    """One gateway, its folder, its way to NATS, and the client that asks it."""

    def __init__(
        self,
        name: str,
        folder: Path,
        nats: NatsServer,
        bus: Bus,
        port: str,
        ttl: float,
        clock: Path | None,
        pause: float = PAUSE,
    ) -> None:
        self.name = name
        self.ttl = ttl
        self.link = Link(nats.port)
        #: When it was continued, each time.
        self.continued_at: list[float] = []
        self.answered_at = 0.0
        self.wrong: list[float] = []
        self.answers: Counter[str] = Counter()
        self._folder = folder / name
        self._folder.mkdir()
        self._bus = bus
        self._port = port
        self._clock = clock
        self._pause = pause
        self._gateway: GatewayProcess | None = None
        self._off = self._folder / "off"
        self._off.write_bytes(bytes(8))
        self._is_over = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """It runs and is asked, in this context."""
        asking = threading.Thread(target=self._keep_asking, name=f"client of {self.name}")
        with self.link:
            self.start()
            asking.start()
            try:
                yield
            finally:
                self._is_over = True
                asking.join()
                self.kill()

    def start(self) -> None:
        if self._clock is not None:
            os.environ |= {"LD_PRELOAD": str(self._clock), "WALL_CLOCK_OFF": str(self._off)}
        try:
            config = CONFIG.format(name=self.name, nats=self.link.port, ttl=self.ttl, port=self._port)
            self._gateway = GatewayProcess(self._folder, config, level="info").__enter__()
        finally:
            os.environ.pop("LD_PRELOAD", None)

    def kill(self) -> None:
        gateway, self._gateway = self._gateway, None
        if gateway is not None:
            gateway.__exit__()

    def end(self) -> int:
        """SIGTERM; the exit code."""
        gateway, self._gateway = self._gateway, None
        assert gateway is not None
        code = gateway.stop()
        gateway.__exit__()
        return code

    def stop(self) -> None:
        assert self._gateway is not None
        self._gateway.signal(signal.SIGSTOP)

    def go_on(self) -> None:
        assert self._gateway is not None
        self.continued_at.append(time.monotonic())
        self._gateway.signal(signal.SIGCONT)

    def set_clock(self, seconds: int) -> None:
        with self._off.open("r+b") as file, mmap.mmap(file.fileno(), 8) as off:
            off[:] = seconds.to_bytes(8, sys.byteorder, signed=True)

    @property
    def silences(self) -> list[float]:
        """For how long it had to be silent each time it took the lease since it was started, in seconds."""
        return [event["silent_s"] for event in self._log if event["event"] == "lease_taken"]

    @property
    def losses(self) -> list[str]:
        """Why it lost the lease each time since it was started."""
        return [event["reason"] for event in self._log if event["event"] == "lease_lost"]

    @property
    def _log(self) -> list[dict[str, Any]]:
        return [] if self._gateway is None else self._gateway.log

    @property
    def known_holder(self) -> str:
        """Who holds the lease, as far as it knows."""
        status = command("status", "--json", "--control", str(self._folder / "control.sock"))
        return str(json.loads(status.stdout)["leases"][0]["holder"]) if status.returncode == 0 else ""

    def tell(self) -> None:
        """Print the last that it has logged."""
        for event in self._log[-12:]:
            print(f"  {self.name}: {event['timestamp']} {event['event']} {event.get('reason', '')}", flush=True)

    def _keep_asking(self) -> None:
        choose = random.Random(self.name)
        while not self._is_over:
            gateway = self._gateway
            if gateway is None or not hasattr(gateway, "port"):
                time.sleep(0.01)
                continue
            with suppress(OSError), socket.create_connection(("127.0.0.1", gateway.port), timeout=1.0) as client:
                while not self._is_over and gateway is self._gateway:
                    self._ask(client, choose.choice(UNITS), choose.randrange(REGISTERS))
                    time.sleep(self._pause * choose.uniform(0.4, 1.6))

    def _ask(self, client: socket.socket, unit: int, register: int) -> None:
        sent_at = time.monotonic()
        client.sendall(mbap.encode(register, unit, bytes((3, 0, register, 0, 1))))
        answer = client.recv(260)
        if not answer:
            raise ConnectionError
        pdu = answer[7:]
        if pdu == bytes((3, 2, unit, register)):
            self.answers["right"] += 1
            self.answered_at = time.monotonic()
        elif pdu[0] & 0x80:
            self.answers[f"{pdu[1]:02X}"] += 1
        else:
            self.answers["wrong"] += 1
            self.wrong.append(time.monotonic())
            for at, sent in tuple(self._bus.heard):
                frame = f"{sent.begins:.4f}-{sent.ends:.4f} {sent.data.hex(' ')}"
                print(f"  heard at {at:.4f}: {sent.by} {sent.to and f'to {sent.to} '}{frame}")
            asked = f"{self.name} was asked for {register} of {unit} at {sent_at:.4f}"
            print(f"wrong: {asked}, and said {answer.hex(' ')}", flush=True)


class Stage:
    """All of it. Faults take a time in seconds."""

    def __init__(self, seed: int, nats: NatsServer, bus: Bus, sites: tuple[Site, Site], *, has_clock: bool) -> None:
        self.sites = sites
        self.gaps: dict[str, float] = defaultdict(float)
        self.bus = bus
        self._nats = nats
        self._choose = random.Random(seed)
        self._faults: dict[str, Callable[[float], None]] = {
            "the holder is killed": lambda lasts: self._kill(self.holder, lasts),
            "the holder is stopped": lambda lasts: self._stop(self.holder, lasts),
            "the standby is killed": lambda lasts: self._kill(self.standby, lasts),
            "the standby is stopped": lambda lasts: self._stop(self.standby, lasts),
            "both are stopped": self._stop_both,
            "NATS is killed": lambda _: self._nats.restart(),
            "NATS is halted": self._halt_nats,
            "NATS is away": self._leave_nats,
            "the holder is cut off": lambda lasts: self._cut(self.holder, lasts),
            "the holder's link is held": lambda lasts: self._hold(self.holder, lasts),
            "the standby's link is held": lambda lasts: self._hold(self.standby, lasts),
        }
        self._faults[OLDER_STORE] = self._roll_back
        if has_clock:
            self._faults["the holder's clock is set"] = lambda lasts: self._set_clock(self.holder, lasts)

    @property
    def holder(self) -> Site:
        """Who asked last."""
        return max(self.sites, key=lambda site: self.bus.asked.get(site.name, 0.0))

    @property
    def standby(self) -> Site:
        return next(site for site in self.sites if site is not self.holder)

    def round(self) -> None:
        """One fault, at any moment."""
        self.wait_for_service()
        fault = self._choose.choice(list(self._faults))
        if fault == OLDER_STORE:
            self.keep_store(released=self._choose.random() < 0.5)
        time.sleep(self._choose.uniform(0.0, 0.5))
        self.suffer(fault, self._choose.uniform(0.0, LONGEST_FAULT * self.holder.ttl))

    def keep_store(self, *, released: bool) -> None:
        """Keep what NATS holds now, which is the lease of the holder or a `released` one; then the holder changes.

        Both gateways have seen that when this returns.
        """
        self.wait_for_service()
        first = self.holder
        if released:
            for site in (self.standby, first):
                site.end()
        self._nats.keep_store()
        if released:
            for site in self.sites:
                site.start()
        else:
            self._stop(first, first.ttl)
        self.wait_for_service()
        deadline = time.monotonic() + PATIENCE
        while not self._agree_on_holder():
            if time.monotonic() > deadline:
                raise SystemExit(f"they do not agree on the holder: {[site.known_holder for site in self.sites]}")

    def _agree_on_holder(self) -> bool:
        first, second = (site.known_holder for site in self.sites)
        return first == second != ""

    def suffer(self, fault: str, lasts: float) -> None:
        """This fault, for so many seconds, and all is well again."""
        self.wait_for_service()
        with Watch(self.sites) as watching:
            self._faults[fault](lasts)
            self.wait_for_service()
        self.gaps[fault] = max(self.gaps[fault], watching.gap)
        if watching.gap > WORTH_TELLING * self.holder.ttl:
            print(f"{fault} for {lasts:.2f} s: nobody was answered for {watching.gap:.2f} s", flush=True)
            for site in self.sites:
                site.tell()

    def was_just_continued(self, collision: Collision) -> bool:
        """Whether one of the two may have been stopped between its look at the clock and its write."""
        return any(
            0 <= collision.at - at <= JUST_CONTINUED
            for site in self.sites
            if site.name in (collision.first, collision.second)
            for at in site.continued_at
        )

    def wait_for_service(self) -> None:
        """Wait until somebody gets answers."""
        deadline = time.monotonic() + PATIENCE
        while max(site.answered_at for site in self.sites) < time.monotonic() - 0.1:
            if time.monotonic() > deadline:
                raise SystemExit(f"nobody has answered for {PATIENCE:g} s: {[site.answers for site in self.sites]}")
            time.sleep(0.01)

    def _kill(self, site: Site, lasts: float) -> None:
        site.kill()
        time.sleep(lasts)
        site.start()

    def _stop(self, site: Site, lasts: float) -> None:
        site.stop()
        time.sleep(lasts)
        site.go_on()

    def _stop_both(self, lasts: float) -> None:
        for site in self.sites:
            site.stop()
        time.sleep(lasts)
        for site in self._choose.sample(self.sites, 2):
            site.go_on()
            time.sleep(self._choose.uniform(0.0, 0.2))

    def _halt_nats(self, lasts: float) -> None:
        self._nats.halt()
        time.sleep(lasts)
        self._nats.resume()

    def _leave_nats(self, lasts: float) -> None:
        self._nats.kill()
        time.sleep(lasts)
        self._nats.start()

    def _roll_back(self, lasts: float) -> None:
        """The holder reaches it again so much later than the standby."""
        holder = self.holder
        holder.link.cut()
        self._nats.kill()
        self._nats.roll_back()
        self._nats.start()
        time.sleep(lasts)
        holder.link.mend()

    def _cut(self, site: Site, lasts: float) -> None:
        site.link.cut()
        time.sleep(lasts)
        site.link.mend()

    def _hold(self, site: Site, lasts: float) -> None:
        site.link.hold()
        time.sleep(lasts)
        site.link.mend()

    def _set_clock(self, site: Site, lasts: float) -> None:
        site.set_clock(self._choose.choice((-86400, -3600, -5, 5, 3600, 86400)))
        time.sleep(lasts)


class Watch:
    """Watches in its context for how long nobody got a right answer."""

    def __init__(self, sites: tuple[Site, Site]) -> None:
        self.gap = 0.0
        self._sites = sites
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name="watch")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join()

    def _run(self) -> None:
        while not self._is_over:
            now = time.monotonic()
            self.gap = max(self.gap, now - max(site.answered_at for site in self._sites))
            time.sleep(0.005)


def wall_clock(folder: Path) -> Path | None:
    """What lets a process have a wall clock of its own; None where nothing compiles it."""
    made = folder / "wall_clock.so"
    source = Path(__file__).with_name("wall_clock.c")
    try:
        subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", made, source, "-ldl"], check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return made


def soak(rounds: int, seed: int, *, server: bool) -> int:
    """So many faults; how often something was wrong."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        bus = Bus(lateness=sometimes_late(seed, share=0.04, longest=0.25))
        clock = wall_clock(folder)
        nats = stack.enter_context(NatsServer(folder))
        sites = []
        for label in ("a", "b"):
            if server:
                port = f"rtu+tcp://127.0.0.1:{bus.server(label)}"
            else:
                port = str(folder / f"tty-{label}")
                bus.terminal(label, Path(port))
            sites.append(Site(label, folder, nats, bus, port, TTL_BEHIND_SERVER if server else TTL, clock))
        stack.enter_context(bus)
        for site in sites:
            stack.enter_context(site.running())
        stage = Stage(seed, nats, bus, (sites[0], sites[1]), has_clock=clock is not None)
        for number in range(1, rounds + 1):
            stage.round()
            for site in sites:
                for at in site.wrong:
                    print(f"{site.name} was wrong {at - bus.changed_at:.2f} s after the last change of the holder")
                site.wrong.clear()
            if number % 25 == 0 or number == rounds:
                print(f"{number} rounds, {len(bus.collisions)} collisions", flush=True)
    return tell(stage)


def tell(stage: Stage) -> int:
    """Print what was found; how often something was wrong."""
    bus = stage.bus
    apart = sum(map(stage.was_just_continued, bus.collisions))
    met = len(bus.collisions) - apart
    for each in bus.collisions:
        print(f"{each.first} and {each.second} at {each.at:.3f}")
    for name, gap in sorted(stage.gaps.items()):
        print(f"{name}: longest gap {gap:.2f} s")
    for site in stage.sites:
        print(f"{site.name}: {dict(site.answers)}")
    wrong = sum(site.answers["wrong"] for site in stage.sites)
    print(f"{bus.held_up} answers were not given, because this machine held them up")
    print(
        f"{bus.frames} frames, {met} of two askers at once, {apart} just after a stop, {wrong} wrong answers, "
        f"longest gap {max(stage.gaps.values()):.2f} s"
    )
    return met + wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--server", action="store_true", help="a device server instead of serial adapters")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that no gateway is left behind
    return 1 if soak(arguments.rounds, arguments.seed, server=arguments.server) else 0


if __name__ == "__main__":
    sys.exit(main())
