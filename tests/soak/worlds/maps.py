"""Units with maps of devices on lines full of faults, behind a server, and of an image; reloads change all of it.

Mirrors and clients of the devices themselves are beside them, and devices that are dead for a while.
"""

import asyncio
from collections import deque
from collections.abc import Mapping
from math import inf

from gateway.modbus.codes import Area
from gateway.runtime.gateway import Gateway
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.dated_world import DatedWorld, keep_asking
from soak.faulty_server import FaultyServer
from soak.judge import Served
from soak.maps.changing import MAPS, MIRROR, NOTES, PLACES, SERVER, SPOTS, TIMINGS, ChangingMaps
from soak.maps.clients import MapClient
from soak.maps.devices import ITEMS, MapDevice, MapImage
from soak.maps.polls_seen import PollsSeen
from soak.maps.reading import Meaning, Own
from soak.tally import Tally
from soak.wires import FAULTS, Wire

_CLIENTS, _OTHERS = 8, 4
#: So many seconds pass from one reload to the next, and a device is dead for so long, at most.
_PAUSE, _DEAD = 4.0, 5.0


class MapsWorld(DatedWorld):
    """A gateway with maps that is reloaded again and again, in front of the same devices."""

    def __init__(self, goal: int, seed: int, seen: PollsSeen) -> None:
        super().__init__(goal, seed)
        self._seen = seen
        self._spots = {
            spot: MapDevice(spot.unit, number=number, writes=self.writes, clock=self.loop.time)
            for number, spot in enumerate(SPOTS, 1)
        }
        self._image = MapImage(len(SPOTS) + 1, self.writes, self.loop.time, self._look)
        self._config = ChangingMaps(self.dice)
        #: What the units of the last gateways mean.
        self._built: deque[tuple[Gateway, Mapping[int, Meaning], Mapping[int, Served]]] = deque(maxlen=2)
        self.bench = GatewayBench(self._config.text)
        self.note(self.bench.gateway)

    def _look(self) -> list[int]:
        image = next(each for each in self.bench.running.gateway.images if each.name == NOTES)
        return list(image.tables[Area.HOLDING].values(0, ITEMS[Area.HOLDING]))

    @property
    def devices(self) -> dict[str, MapDevice]:
        """The sources by their names, by the config that was made last."""
        return {name: self._spots[spot] for name, spot in self._config.names.items()} | {NOTES: self._image}

    def connect(self, share: float, seed: int) -> list[Wire]:
        """Connect the devices to their lines; these."""
        wires = []
        for at, (place, timing) in enumerate(TIMINGS.items()):
            on_line = [self._spots[spot] for spot in SPOTS if spot.place == place]
            faulty = FaultyLine(timing, *on_line, share=share, seed=10 * seed + at, faults=FAULTS)
            name = place.removeprefix("/dev/")
            wires.append(Wire(self, name, self.bench.lines[name], faulty))
        behind = {spot.unit: self._spots[spot] for spot in SPOTS if spot.place == SERVER}
        self._server = FaultyServer(self, self.bench.lines[SERVER], behind, share=share, seed=seed)
        return wires

    def note(self, gateway: Gateway) -> None:
        """A gateway was built by the config that was made last."""
        before = self._built[-1][1] if self._built else {}
        meanings = {}
        for unit in MAPS:
            it = self._config.maps[unit]
            old = before.get(unit)
            is_same = old is not None and old.map.own == it.own
            own = old.own if is_same else {address: Own() for address in it.own}
            meanings[unit] = Meaning(it, self.devices, own, dict(self._seen.of_device))
        served = {spot.known_as: Served(device) for spot, device in self._spots.items()}
        mirrored = self._spots[self._config.names[self._config.mirrored]]
        served[MIRROR] = Served(mirrored, self._config.stale_of_mirror)
        served[MIRROR].written_at = mirrored.written_at[Area.HOLDING]
        self._built.append((gateway, meanings, served))

    def meanings(self) -> Mapping[int, Meaning]:
        """What units with maps mean by the config in force."""
        return next(meanings for gateway, meanings, _ in self._built if gateway is self.bench.running.gateway)

    def units(self) -> Mapping[int, Served]:
        """What all other units lead to by the config in force."""
        return next(served for gateway, _, served in self._built if gateway is self.bench.running.gateway)

    def settled(self) -> None:
        """All that a reload began is over."""
        for meaning in self.meanings().values():
            meaning.settled_at = self.loop.time()

    async def keep_reloading(self) -> None:
        """Change the config and reload it."""
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(0.0, _PAUSE))
            self._config.change()
            gateway = self.bench.rebuilt(self._config.text)
            self.note(gateway)
            for meaning in self.meanings().values():
                meaning.settled_at = inf
            await self.bench.running.switch(gateway)
            self.bench.gateway = gateway
            self.settled()
            self.tally.counts["reloads"] += 1

    async def keep_killing(self) -> None:
        """Let a device on a line, or the server, be dead for a while."""
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(0.0, 2 * _DEAD))
            place = self.dice.choice(PLACES)
            seconds = self.dice.uniform(0.0, _DEAD)
            if place == SERVER:
                self._server.is_deaf = True
                self.loop.call_later(seconds, setattr, self._server, "is_deaf", False)
            else:
                device = self.dice.choice([device for spot, device in self._spots.items() if spot.place == place])
                device.dead_until = self.loop.time() + seconds


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    with PollsSeen() as seen:
        world = MapsWorld(transactions, seed, seen)
        bench = world.bench
        async with keep_lines_open(bench.running):
            wires = world.connect(share, seed)
            world.settled()
            clients = [keep_asking(world, bench.gateway, n, pause=0.1, kind=MapClient) for n in range(_CLIENTS)]
            others = [keep_asking(world, bench.gateway, 100 + n, pause=0.2) for n in range(_OTHERS)]
            pulling = [wire.keep_pulling() for wire in wires]
            return await world.run(
                bench.events, world.keep_reloading(), world.keep_killing(), *clients, *others, *pulling
            )
