"""A gateway that keeps readings, and faults: it is killed, ended, reloaded, and its broker is away or stands still."""

import json
import math
import mmap
import os
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from gateway.plant.kept.history import SETTLING
from kit.process import PATIENCE, GatewayProcess, command
from soak.kept_messages import GROUP, SITE, Heard, told_by
from soak.kept_record import Break, Record, Told
from soak.kept_tap import Packet
from soak.kept_world import DEVICES, EVERY, PROFILE, TIMEOUT, Counters, Loop, PlantBroker

KEEP_EVERY = 1.0
#: What was confirmed may not be seen as such when the connection is lost so soon after, in seconds.
UNSEEN = 1.0
#: The longest time that a fault lasts, in seconds.
LONGEST = 3.0
#: An answer is taken within so many seconds, or by the gateway before a reload or an end.
TAKEN = 0.1
#: All history was sent when none has come for so long, in seconds.
QUIET = SETTLING + 2 * KEEP_EVERY + 1.0
RELOADED = "config_applied"
PLAIN, SPARKPLUG = "plain", "sparkplug"
CONFIG = """
site = "{site}"
[[listen]]
bind = "tcp://127.0.0.1:0"
{profile}
[[upstream]]
name = "counters"
to = "tcp://127.0.0.1:{devices}"
rest = "off"
units = [{{ unit = "1-{last}", name = "counter-*", profile = "counter", timeout = "{timeout:g} s" }}]
[mqtt]
broker = "mqtt://127.0.0.1:{broker}"
publish = [
  {{ device = "counter-*", points = ["count", "slow"], every = "250 ms", at_least = "{at_least} min" }},
  {{ device = "counter-*", points = ["other"], every = "500 ms" }},
]
{keep}
{form}
"""
#: The gateway as it is, but that it connects again soon; and with one defect.
PROGRAM = """
import sys
from gateway.plant import steadiness
steadiness.FIRST_PAUSE, steadiness.LONGEST_PAUSE = 0.3, 1.0
{lie}
from gateway.cli.main import main
sys.exit(main())
"""
LIES = {
    "": "",
    "keeps less": """
from gateway.plant.kept import keeper
whole, numbers = keeper.Keeper.keep, iter(range(10**9))
keeper.Keeper.keep = lambda self, device, readings: whole(self, device, readings) if next(numbers) % 50 else None
""",
    "forgets nothing": """
from gateway.plant.kept import keeper
keeper.Keeper.sent = lambda self, batch: self.rewind()
""",
    "writes nothing": """
from gateway.plant.kept import file
file.KeptFile.write = lambda self, chunks, gone: 0
""",
}


class Scene(NamedTuple):
    """What has happened between two times."""

    begun: float
    ended: float
    text: str


#: Something to be done.
Does = Callable[[], None]


class Stage:
    """A gateway, what surrounds it, and what happens to it. Faults take a time in seconds."""

    def __init__(
        self,
        folder: Path,
        loop: Loop,
        seed: int,
        form: str,
        *,
        keep: bool = True,
        clock: Path | None = None,
        disk: Path | None = None,
        late: float = 1.0,
    ) -> None:
        self.faults: Counter[str] = Counter()
        self.story: list[Scene] = []
        self.counters = Counters()
        self.plant = PlantBroker(folder, loop)
        self.form = form
        self.choose = random.Random(seed)
        self._record = Record(EVERY, TIMEOUT, late, slow=frozenset({"slow"}))
        #: What was answered so lately may not be on the disk.
        self._unwritten = KEEP_EVERY + late
        if form == SPARKPLUG:
            self._record.live_qos = self._record.history_qos = 0
            self._record.live_retained = False
        self._folder = folder
        self._loop = loop
        self._keep = keep
        self._at_least = 1
        self._stands_since = self._stood_until = 0.0
        self._clock = clock
        self._disk = disk
        self._off = folder / "off"
        self._off.write_bytes(bytes(8))
        self._gateway: GatewayProcess | None = None
        self._logs: list[list[dict[str, Any]]] = []
        self.kinds: dict[str, Callable[[float], None]] = {
            "the gateway is killed": self._killed,
            "the gateway ends": self._ended,
            "the broker is killed": lambda lasts: self._away(signal.SIGKILL, lasts),
            "the broker ends": lambda lasts: self._away(signal.SIGTERM, lasts),
            "both are killed": lambda lasts: self._away(signal.SIGKILL, lasts, self._kill),
            "the broker is away, the gateway is killed": lambda lasts: self._meanwhile(lasts, self._killed),
            "the broker is away, the gateway ends": lambda lasts: self._meanwhile(lasts, self._ended),
            "the broker is away, and a reload": lambda lasts: self._meanwhile(lasts, self._reload_changed),
            "the broker stands still": self._still,
            "the broker stands still, and is killed": lambda lasts: self._still(lasts, killed=True),
            "the broker stands still, the gateway ends": lambda lasts: self._still(lasts, self._end),
            "the broker stands still, the gateway is killed": lambda lasts: self._still(lasts, self._kill),
            "the broker stands still, both are killed": lambda lasts: self._still(lasts, self._kill, killed=True),
            "the connection is cut": self._cut,
            "a reload": lambda _: self._reload(),
            "a reload with other values": self._reload_changed,
            "a device is silent": self._silent,
            "the broker is away, a device is silent": lambda lasts: self._meanwhile(lasts, self._silent),
        }
        if clock is not None:
            self.kinds |= {
                "the clock is set": self._set_clock,
                "the broker is away, the clock is set": lambda lasts: self._meanwhile(lasts, self._set_clock),
            }

        if disk is not None:
            self.kinds["the disk is full, the broker is away"] = self._full

    @contextmanager
    def running(self) -> Iterator[None]:
        """All of it runs, in this context."""
        self._loop.do(self.counters.start())
        try:
            self.plant.start()
            self._start()
            self._record.ends.append(time.time())
            self.wait_for_values()
            yield
        finally:
            if self._gateway is not None:
                self._gateway.__exit__()
            self.plant.stop()
            self._loop.do(self.counters.stop())

    def round(self, kind: str) -> None:
        """This fault, at any moment and for any time."""
        time.sleep(self.choose.uniform(0.0, 1.0))
        self.suffer(kind, self.choose.uniform(0.0, LONGEST))

    def suffer(self, kind: str, lasts: float) -> None:
        """This fault; afterwards values come again."""
        self.faults[kind] += 1
        begun = time.time()
        self.kinds[kind](lasts)
        self.wait_for_values()
        self.story.append(Scene(begun, time.time(), f"{kind}, {lasts:.2f} s"))

    def wait_for_values(self) -> None:
        """Wait until the gateway publishes."""
        known, deadline = len(self.plant.consumer.heard), time.monotonic() + PATIENCE
        while not any(self._told(each) for each in self.plant.consumer.heard[known:]):
            assert time.monotonic() < deadline, self._gateway and self._gateway.log[-20:]
            time.sleep(0.02)

    def wait_until_sent(self) -> None:
        """Wait until no history comes any more."""
        known, deadline = 0, time.monotonic() + PATIENCE
        last = time.monotonic()
        while time.monotonic() < last + QUIET:
            assert time.monotonic() < deadline, "history comes without an end"
            heard = self.plant.consumer.heard
            if any(told.is_history for each in heard[known:] if (told := self._told(each))):
                last = time.monotonic()
            known = len(heard)
            time.sleep(0.05)

    def record(self) -> Record:
        """What has happened up to now; of the last answers nothing is asked."""
        record, tap = self._record, self.plant.tap
        now = time.time()
        heard = [*self.plant.consumer.heard]
        packets, confirmed = [*tap.packets], {**tap.confirmed}
        record.answers = [*self.counters.answers]  # last: whatever was heard was answered before
        told = (
            self._told(each, each.connection, each.qos, each.is_retained, confirmed.get(place))
            for place, each in enumerate(packets)
        )
        record.sent = [each for each in told if each is not None]
        record.heard = [each for each in map(self._told, heard) if each is not None]
        events = [event for log in self._logs for event in [*log] if event["event"] == "request_timeout"]
        record.too_late = [
            (event["device"], datetime.fromisoformat(event["timestamp"]).timestamp()) for event in events
        ]
        return replace(record, may_lose=[*record.may_lose, (now - record.late, math.inf)])

    @property
    def kept(self) -> Any:
        """What the status says of what is kept; None if it says nothing."""
        told = command("status", "--json", "--control", str(self._folder / "control.sock"))
        return json.loads(told.stdout)["brokers"][0].get("kept")

    @property
    def kept_in_the_end(self) -> Any:
        """What it says when it had time to write that all was sent."""
        deadline = time.monotonic() + PATIENCE / 10
        while (kept := self.kept) and kept["values"] and time.monotonic() < deadline:
            time.sleep(KEEP_EVERY)
        return kept

    def tell(self) -> None:
        """Print the last that the gateway has logged."""
        for event in [] if self._gateway is None else self._gateway.log[-20:]:
            print(f"  {event}")

    # --- the gateway ---

    def _start(self) -> None:
        if self._clock is not None:
            os.environ |= {"LD_PRELOAD": str(self._clock), "WALL_CLOCK_OFF": str(self._off)}
        if self._disk is not None:
            os.environ["STATE_DIRECTORY"] = str(self._disk)
        try:
            self._gateway = GatewayProcess(self._folder, self._config(), level="info").__enter__()
        finally:
            for name in ("LD_PRELOAD", "STATE_DIRECTORY"):
                os.environ.pop(name, None)
        self._logs.append(self._gateway.log)

    def _config(self) -> str:
        form = f'sparkplug = {{ group = "{GROUP}" }}' if self.form == SPARKPLUG else ""
        keep = f'keep = "16 MiB"\nkeep_every = "{KEEP_EVERY:g} s"' if self._keep else ""
        own = {"devices": self.counters.port, "broker": self.plant.tap.port, "at_least": self._at_least}
        return CONFIG.format(site=SITE, profile=PROFILE, timeout=TIMEOUT, last=DEVICES, keep=keep, form=form, **own)

    def _kill(self) -> Does:
        """Kill it; call what is returned to start another one."""
        assert self._gateway is not None
        at = time.time()
        self._gateway.signal(signal.SIGKILL)
        self._gateway.wait()
        self._break(self._unwritten, at)
        return lambda: self._start_again(at - self._unwritten)

    def _end(self) -> Does:
        """End it in order; call what is returned to start another one."""
        assert self._gateway is not None
        at = time.time()
        code = self._gateway.stop()
        assert code == 0, (code, self._gateway.log[-20:], self._gateway.rest)
        self._note_end(at)
        return lambda: self._start_again(at - TAKEN)

    def _start_again(self, lost_from: float) -> None:
        assert self._gateway is not None
        self._gateway.__exit__()
        self._record.may_lose.append((lost_from, time.time()))
        self._start()
        self._record.ends.append(time.time())

    def _reload_changed(self, _: float) -> None:
        self._reload(changed=True)

    def _reload(self, *, changed: bool = False) -> None:
        """Read the config again; `changed`: with other rows of `publish`, so that it connects anew."""
        assert self._gateway is not None
        at = time.time()
        if changed:
            self._at_least = 3 - self._at_least
            text = self._gateway.config.read_text()
            rest = text[text.index("[log]") :]
            self._gateway.config.write_text(f"{self._config()}\n{rest}")
        self._gateway.signal(signal.SIGHUP)
        self._gateway.wait_for(RELOADED)
        if changed:
            self._note_end(at)
            self._record.ends.append(time.time())
            self._record.may_lose.append((at - TAKEN, time.time() + TAKEN))

    # --- faults ---

    def _killed(self, lasts: float) -> None:
        start = self._kill()
        time.sleep(lasts / 4)
        start()

    def _ended(self, lasts: float) -> None:
        start = self._end()
        time.sleep(lasts / 4)
        start()

    def _away(self, number: signal.Signals, lasts: float, first: Callable[[], Does] | None = None) -> None:
        """The broker is away for this time. `first` happens just before, and what it returns in the middle."""
        then = first() if first else None
        self.plant.end(number)
        self._break(UNSEEN)
        time.sleep(lasts / 2)
        if then is not None:
            then()
        time.sleep(lasts / 2)
        self.plant.start()
        self._break(UNSEEN)

    def _meanwhile(self, lasts: float, does: Callable[[float], None]) -> None:
        """The broker is away; something happens meanwhile."""
        self.plant.end(self.choose.choice((signal.SIGKILL, signal.SIGTERM)))
        self._break(UNSEEN)
        time.sleep(lasts)
        does(lasts / 2)
        time.sleep(self.choose.uniform(0.0, LONGEST / 2))
        self.plant.start()

    def _still(self, lasts: float, first: Callable[[], Does] | None = None, *, killed: bool = False) -> None:
        """The broker stands still for this time; at its end `first` happens, and then it goes on or is `killed`."""
        if time.time() - self._stood_until > self._unwritten:  # else what it had not confirmed may not be yet
            self._stands_since = time.time()
        self.plant.broker.signal(signal.SIGSTOP)
        time.sleep(lasts)
        then = first() if first else None
        if killed:
            self.plant.end(signal.SIGKILL)
        else:
            self.plant.broker.signal(signal.SIGCONT)
        if then is not None or killed:
            self._break(time.time() - self._stands_since + UNSEEN)
        self._stood_until = time.time()
        if then is not None:
            then()
        if killed:
            self.plant.start()

    def _cut(self, lasts: float) -> None:
        self.plant.cut()
        self._break(UNSEEN)
        time.sleep(lasts)
        self.plant.mend()

    def _silent(self, lasts: float) -> None:
        unit = self.choose.randint(1, DEVICES)
        self.counters.silent.add(unit)
        time.sleep(lasts)
        self.counters.silent.discard(unit)

    def _full(self, lasts: float) -> None:
        """The disk is full while the broker is away, and has room again before the broker is back, or after."""
        assert self._disk is not None
        filling = self._disk / "filling"
        with suppress(OSError), filling.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        self.plant.end(signal.SIGKILL)
        self._break(self._record.late)
        time.sleep(KEEP_EVERY + lasts)
        if self.choose.random() < 0.5:
            filling.unlink()
            time.sleep(lasts)
        self.plant.start()
        self.wait_for_values()
        filling.unlink(missing_ok=True)

    def _set_clock(self, lasts: float) -> None:
        """Set the wall clock of the gateway; it stays so."""
        off = self.choose.choice((-86400, -3600, -5, 0, 5, 3600, 86400))
        time.sleep(lasts / 2)
        self._record.clock.append((time.time(), off))
        with self._off.open("r+b") as file, mmap.mmap(file.fileno(), 8) as shared:
            shared[:] = off.to_bytes(8, sys.byteorder, signed=True)
        time.sleep(lasts / 2)

    def _break(self, reach: float, at: float | None = None) -> None:
        """Note an unclean end. What a broker had not confirmed when it stood still may not be confirmed yet."""
        at = time.time() if at is None else at
        if at - self._stood_until < self._unwritten:
            reach = max(reach, at - self._stands_since + UNSEEN)
        self._record.breaks.append(Break(at, reach))
        self._record.ends.append(at)

    def _note_end(self, at: float) -> None:
        """Note a proper end."""
        self._record.clean_ends.append(Break(at, at - self._record.ends[-1] + self._record.late))
        self._record.ends.append(at)

    def _told(self, heard: Heard | Packet, *more: Any) -> Told | None:
        names = ("connection", "qos", "is_retained", "confirmed_at")
        return told_by(heard, is_sparkplug=self.form == SPARKPLUG, **dict(zip(names, more, strict=False)))
