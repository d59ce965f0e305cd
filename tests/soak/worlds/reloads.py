"""Reloads that swap units, lines and servers, rename, add and remove them and change limits, while answers are owed.

A unit means what the config says that is in force when it is asked.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

from gateway.config.load import parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve
from gateway.devices.device import Device
from gateway.ports.port import OpenPort, Port, PortSettings, PortUser
from gateway.readconfig.process import ConfigRead
from gateway.runtime.build import Builder
from gateway.runtime.gateway import Gateway
from gateway.runtime.reload import Reloader
from gateway.service.systemd import Notifier
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.changing_config import LATE_WINDOW, NUMBERS, PLACES, SERVERS, TIMINGS, UNITS, ChangingConfig, Spot
from soak.dated import DatedDevice
from soak.dated_world import DatedWorld, keep_asking
from soak.faulty_server import FaultyServer
from soak.judge import Served
from soak.tally import Tally
from soak.wires import FAULTS, SERVER_FAULTS, Wire

_CLIENTS: Final = 12
#: So many seconds pass from one reload to the next at most.
_PAUSE: Final = 0.6
_ERROR: Final = "[[line]]\nport = 7\n"
#: So many units are asked, too, that may have no meaning.
_UNKNOWN: Final = 2
#: What units lead to.
Units = Mapping[int, Served]


class _Bench(GatewayBench):
    """It knows who has opened each port last."""

    def __init__(self, config: str) -> None:
        self.owners: dict[str, object] = {}
        super().__init__(config)

    def _open(self, settings: PortSettings) -> OpenPort:
        open_port = super()._open(settings)

        async def open_and_remember(user: PortUser) -> Port:
            self.owners[settings.port] = user.received.__self__
            return await open_port(user)

        return open_and_remember


class _NotingBuilder:
    """It tells of each gateway that it builds."""

    def __init__(self, builder: Builder, note: Callable[[Gateway], None]) -> None:
        self.prepare, self.custom = builder.prepare, builder.custom
        self._builder = builder
        self._note = note

    def build(self, plan: Plan, before: Gateway) -> Gateway:
        gateway = self._builder.build(plan, before)
        self._note(gateway)
        return gateway


class _Wire(Wire):
    """A line whose devices are late by the limit of the line that asks them."""

    def __init__(self, world: "_World", place: str, faulty: FaultyLine) -> None:
        super().__init__(world, place, world.bench.lines[place.removeprefix("/dev/")], faulty)
        self._limit = lambda: world.limits[world.bench.owners[place]]

    def _written(self, data: bytes) -> None:
        for device in self.faulty.devices:
            device.timeout = self._limit()
        super()._written(data)


class _World(DatedWorld):
    """A gateway that is reloaded again and again, in front of the same devices."""

    def __init__(self, goal: int, seed: int) -> None:
        super().__init__(goal, seed)
        spots = [Spot(place, unit) for place in PLACES for unit in UNITS]
        self._devices = {spot: self.device(spot.unit, number) for number, spot in enumerate(spots)}
        self._config = ChangingConfig(self.dice)
        self._text = self._config.text
        #: What units lead to by the config that was read last; by those of the last gateways that were built.
        self._read_units: Units = self._units_of_config({})
        self._built: deque[tuple[Gateway, Units]] = deque(maxlen=2)
        #: What the lines of these allow their devices, in seconds.
        self.limits: dict[object, float] = {}
        self.bench = _Bench(self._text)
        self.running = self.bench.running
        self.bench.running.builder = _NotingBuilder(self.bench.running.builder, self.note)
        self.note(self.bench.gateway)

    def connect(self, share: float, seed: int) -> None:
        """Connect the devices to the lines, which have been open once."""
        for at, (place, timing) in enumerate(TIMINGS.items()):
            faults = SERVER_FAULTS if "tcp" in place else FAULTS
            devices = [self._devices[place, unit] for unit in UNITS]
            _Wire(
                self,
                place,
                FaultyLine(timing, *devices, share=share, seed=10 * seed + at, faults=faults, late_window=LATE_WINDOW),
            )
        for at, server in enumerate(SERVERS):
            behind = {unit: self._devices[server, unit] for unit in UNITS}
            FaultyServer(self, self.bench.lines[server], behind, share=share, seed=10 * seed + at)

    def units(self) -> Units:
        """What units lead to by the config in force."""
        return next(units for gateway, units in self._built if gateway is self.running.gateway)

    def shown(self) -> Iterable[tuple[Device, DatedDevice | None]]:
        for owner in self.running.gateway.owners:
            for device in owner.devices.values():
                yield device, self._devices.get(Spot(owner.plan.port.port, device.settings.unit))

    async def keep_reloading(self) -> None:
        """Change the config and reload it, sometimes twice in a row, and with an error in it now and then."""
        reloader = Reloader(Path("gateway.toml"), self.running, Notifier({}), read=self._read)
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(0.0, _PAUSE))
            if self.dice.random() < 0.2:
                self._config.change()
                self._text = self._config.text
                reloader.order()
                await asyncio.sleep(self.dice.uniform(0.0, 0.2))
            self._config.change()
            error = _ERROR if self.dice.random() < 0.1 else ""
            self._text = self._config.text + error
            outcome = await reloader.order()
            self.tally.counts["rejected" if outcome.problems else "reloads"] += 1
            if bool(outcome.problems) != bool(error) or outcome.defect:
                self.tally.complain(f"a reload came to this: {outcome}")

    def _read(self, file: Path, *, look_around: bool = False) -> ConfigRead:
        loaded = parse(self._text, port_trouble=lambda port: None, real_path=lambda port: port)
        self._read_units = self._units_of_config(self._built[-1][1])
        return ConfigRead(loaded.config and resolve(loaded.config), loaded.problems)

    def note(self, gateway: Gateway) -> None:
        """A gateway was built by the config that was read last."""
        self._built.append((gateway, self._read_units))
        lines = [line for each, _ in self._built for line in each.lines]
        self.limits = {line.driver: line.plan.devices[0].answer_time.timeout for line in lines}

    def _units_of_config(self, before: Units) -> Units:
        """What its units lead to. A mirror shows what was written to its device through the one `before`, too."""
        units = {number: Served(None) for number in self.dice.sample(NUMBERS, _UNKNOWN)}
        for number, (spot, stale) in self._config.meaning.items():
            served = units[number] = Served(self._devices.get(spot), stale)
            last = before.get(number)
            if last is not None and last.device is served.device and None not in (last.stale, stale):
                served.written_at = last.written_at
        return units


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    world = _World(transactions, seed)
    bench = world.bench
    async with keep_lines_open(bench.running):
        world.running.ready.set()
        world.connect(share, seed)
        clients = (keep_asking(world, bench.gateway, number, pause=0.05) for number in range(_CLIENTS))
        return await world.run(bench.events, world.keep_reloading(), *clients)
