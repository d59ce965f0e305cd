"""Rows by address, guarded points and clients with priority, all of which reloads change, on lines with faults.

Each request is judged by rules of the test's own: what they forbid is refused at once, and no device does it or is
asked for it; what they allow is never refused with 01, and with 03 only while a reload changes guards.
"""

import asyncio
from collections import deque
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.runtime.gateway import Gateway
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.dated import DatedDevice
from soak.dated_world import DatedWorld, JudgingClient, keep_asking
from soak.faulty_server import TIMEOUT, FaultyServer
from soak.judge import NO_ANSWER, Served
from soak.rules import DENIED, GUARDED, LISTENERS, MIRROR, NETWORKS, OTHERS, OUTSIDE, Rules
from soak.tally import Tally
from soak.wires import FAULTS, Wire

_CLIENTS: Final = 16
#: So many seconds pass from one reload to the next at most.
_PAUSE: Final = 2.0
#: No device acts later than so many seconds after a client has asked: requests wait, and the server may be late.
_LATEST: Final = 10.0
_TIMING: Final = LineTiming("rtu", 57600, CharacterFormat.parse("8E1"))
_LATE_WINDOW: Final = 0.5
_SERVER: Final = "tcp://10.0.0.1:502"
_STALE: Final = 1.0
_POLL: Final = bytes((0, 0, 0, 8))
_LISTEN: Final = "".join(f'[[listen]]\nname = "{name}"\nbind = "tcp://127.0.0.1:0"\n' for name in LISTENERS)
_CONFIG: Final = f"""
{_LISTEN}
[profile.guarded]
points = [POINTS]

[[line]]
name    = "rtu"
port    = "/dev/rtu"
baud    = {_TIMING.baud}
latency = "5 ms"
late_window = "{1000 * _LATE_WINDOW:g} ms"
devices = [
  {{ unit = "1-2", as = "11-12", name = "guarded-*", profile = "guarded", timeout = "50 ms" }},
  {{ unit = 3, as = 13, timeout = "50 ms" }},
]

[[upstream]]
name    = "server"
to      = "{_SERVER}"
timeout = "{1000 * TIMEOUT:g} ms"
units   = [{{ as = "21-22", unit = "1-2" }}]

[[image]]
unit  = {MIRROR}
of    = "guarded-{GUARDED[0]}"
stale = "{1000 * _STALE:g} ms"
read  = [{{ holding = "0-7", every = "200 ms" }}, {{ input = "0-7", every = "200 ms" }}]
"""


class _Client(JudgingClient):
    """A client that knows what it may ask."""

    def __init__(self, world: "_World", gateway: Gateway, name: str, writes: float) -> None:
        number = int(name.partition(":")[0].rpartition(".")[2])
        host, at = f"{NETWORKS[number % 2]}{number}", number // 2 % 2
        super().__init__(world, gateway, name, writes, host=host, listener=at)
        self._rules = world
        self._who = host, LISTENERS[at]
        #: Of each request under way, by its task: what the gateway may refuse it with, and whether that came at once.
        self._expected: dict[object, tuple[set[int], bool]] = {}

    async def _asks(self, unit: int, served: object, pdu: bytes) -> bytes:
        world, asked_at = self._rules, self._loop.time()
        refusal, changes = world.rules.refusal(*self._who, unit, pdu), world.changes
        may_wait = unit == MIRROR and refusal != DENIED  # for its client's other requests, and the guards may change
        if may_wait or not refusal:
            world.allow(unit, pdu)
        response = await super()._asks(unit, served, pdu)
        expected = {0, OUTSIDE} if may_wait and changes != world.changes else {refusal}
        self._expected[asyncio.current_task()] = expected, self._loop.time() == asked_at
        return response

    def _judged(self, kind: str, served: Served, unit: int, pdu: bytes, response: bytes, trouble: str | None) -> bool:
        expected, was_at_once = self._expected.pop(asyncio.current_task())
        refused = response[1] if response[0] & EXCEPTION_BIT and response[1] in (DENIED, OUTSIDE) else 0
        if refused:
            trouble = None
        if refused not in expected and not (refused == 0 and response[1:] == bytes((NO_ANSWER,)) and unit == MIRROR):
            trouble = f"the rules say {sorted(expected)} to {self._who}: {self._rules.rules.rows_text}"
        elif refused == DENIED and not was_at_once:
            trouble = "it was not refused at once"
        self._tally.counts[f"refused with {refused:02X}"] += refused > 0
        return super()._judged(kind, served, unit, pdu, response, trouble)


class _Device(DatedDevice):
    """A device that tells what it is asked."""

    def __init__(self, world: "_World", unit: int) -> None:
        super().__init__(unit % 10, number=unit, writes=world.writes, clock=world.loop.time)
        self._rules = world

    def respond(self, pdu: bytes) -> bytes:
        self._rules.asked(self.number, pdu)
        return super().respond(pdu)


class _World(DatedWorld):
    """A gateway whose rows and guards change."""

    def __init__(self, goal: int, seed: int) -> None:
        super().__init__(goal, seed)
        first = Rules.of_chance(self.dice)
        self.bench = GatewayBench(self._text(first))
        #: The rules of the last gateways that were built.
        self._built = deque([(self.bench.gateway, first)], maxlen=2)
        #: When somebody who may has last asked a unit for something that only reads.
        self._allowed: dict[tuple[int, bytes], float] = {}
        self._devices = {unit: _Device(self, unit) for unit in (*GUARDED, *OTHERS)}
        self.served |= {unit: Served(device) for unit, device in self._devices.items()}
        self.served[MIRROR] = Served(self._devices[GUARDED[0]], _STALE)

    @property
    def rules(self) -> Rules:
        """Those in force."""
        return next(rules for gateway, rules in self._built if gateway is self.bench.running.gateway)

    @property
    def changes(self) -> int:
        """How often they have changed."""
        return self.tally.counts["reloads"]

    def connect(self, share: float, seed: int) -> None:
        """Connect the devices to the line and the server, which have been open once."""
        line = [self._devices[unit] for unit in (*GUARDED, OTHERS[0])]
        faulty = FaultyLine(_TIMING, *line, share=share, seed=10 * seed, faults=FAULTS, late_window=_LATE_WINDOW)
        Wire(self, "rtu", self.bench.lines["rtu"], faulty)
        behind = {unit % 10: self._devices[unit] for unit in OTHERS[1:]}
        FaultyServer(self, self.bench.lines[_SERVER], behind, share=share, seed=10 * seed + 1)

    async def keep_reloading(self) -> None:
        """Change rows and guards again and again."""
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(0.0, _PAUSE))
            rules = Rules.of_chance(self.dice, self._built[-1][1])
            gateway = self.bench.rebuilt(self._text(rules))
            self._built.append((gateway, rules))
            await self.bench.running.switch(gateway)
            self.bench.gateway = gateway
            self.tally.counts["reloads"] += 1

    def allow(self, unit: int, pdu: bytes) -> None:
        """Somebody asks what it may."""
        self._allowed[GUARDED[0] if unit == MIRROR else unit, pdu] = self.loop.time()

    def asked(self, number: int, pdu: bytes) -> None:
        """A device is asked for something: it is a poll, or somebody who may has asked for it."""
        is_poll = number == GUARDED[0] and pdu[1:] == _POLL
        if not is_poll and self.loop.time() - self._allowed.get((number, pdu), -_LATEST) > _LATEST:
            self.tally.complain(f"nobody who may has asked {number}: {pdu.hex(' ').upper()}")

    @staticmethod
    def _text(rules: Rules) -> str:
        return _CONFIG.replace("POINTS", rules.points_text) + rules.rows_text


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    world = _World(transactions, seed)
    async with keep_lines_open(world.bench.running):
        world.connect(share, seed)
        gateway = world.bench.gateway
        clients = (keep_asking(world, gateway, number, pause=0.05, kind=_Client) for number in range(_CLIENTS))
        return await world.run(world.bench.events, world.keep_reloading(), *clients)
