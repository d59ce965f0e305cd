"""Units behind Modbus TCP servers that answer late, twice, never, in any order, mislabelled, and that hang up.

Some need manners: pauses, one request at a time, another address, to be woken, to be left alone.
"""

import asyncio
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from typing import Final

from gateway.devices.device import Device
from kit.gateway_bench import GatewayBench, keep_lines_open
from kit.memory import MemoryLine
from soak.dated import DatedDevice
from soak.dated_world import DatedWorld, keep_asking
from soak.faulty_server import TIMEOUT, FaultyServer, Manners
from soak.judge import Served
from soak.tally import Tally


@dataclass(frozen=True, kw_only=True)
class _Server:
    """A server with so many units and addresses, and the keys that it is given in the config."""

    units: int = 2
    keys: str = ""
    manners: Manners | None = None
    addresses: int = 1


_SERVERS: Final = {
    "many": _Server(units=6),
    "few": _Server(keys="in_flight = 2"),
    "one": _Server(units=1, manners=Manners(knows_units=False)),
    "repeating": _Server(keys="retries = 2\ncoalesce = false"),
    "needs a pause": _Server(keys='gap = "20 ms"', manners=Manners(gap=0.02)),
    "one at a time": _Server(keys="in_flight = 1", manners=Manners(gap=0.0)),
    "always 0": _Server(keys='transaction_id = "zero"', manners=Manners(zeros=1.0)),
    "sometimes 0": _Server(
        keys='transaction_id = "zero"\nretries = 1\nwake = "100 ms"', manners=Manners(zeros=0.5, repeats=0.3)
    ),
    "all 0": _Server(
        keys='transaction_id = "zero"\nretries = 1\nrest = "off"',
        manners=Manners(zeros=1.0, knows_units=False),
    ),
    "leaves": _Server(manners=Manners(idle=0.15, opens_in=0.05)),
    "left": _Server(keys='idle = "30 ms"', manners=Manners(idle=0.1, opens_in=0.02)),
    "sleeps": _Server(keys='wake = "200 ms"', manners=Manners(sleeps_after=0.25)),
    "two addresses": _Server(keys='retries = 1\nrest = "off"', addresses=2),
    "two, always 0": _Server(
        keys='transaction_id = "zero"\nidle = "50 ms"\nrest = "off"',
        manners=Manners(zeros=1.0, opens_in=0.02),
        addresses=2,
    ),
}
_CLIENTS: Final = 24
#: For so long an address is as it is, in seconds, at most.
_CHANGES_AFTER: Final = 3.0


def _addresses(at: int) -> list[str]:
    return [f"tcp://10.{number}.0.{at}:502" for number in range([*_SERVERS.values()][at].addresses)]


_HEAD: Final = '[profile.generic]\npoints = [{ name = "first", holding = 0 }]\n'
CONFIG: Final = _HEAD + "".join(
    f"""
    [[upstream]]
    name      = "{name}"
    to        = {_addresses(at)}
    units     = [{{ as = "{10 * at + 1}-{10 * at + server.units}", unit = "1-{server.units}" }}]
    timeout   = "{1000 * TIMEOUT:g} ms"
    {server.keys}
    """
    for at, (name, server) in enumerate(_SERVERS.items())
)


class _World(DatedWorld):
    """Each unit is what it is all the time."""

    def __init__(self, bench: GatewayBench, goal: int, seed: int) -> None:
        super().__init__(goal, seed)
        self._bench = bench

    def shown(self) -> Iterable[tuple[Device, DatedDevice | None]]:
        for upstream in self._bench.gateway.upstreams:
            yield from ((device, self.served[known_as].device) for known_as, device in upstream.devices.items())


async def _keep_changing(world: DatedWorld, bench: GatewayBench, places: dict[str, FaultyServer]) -> None:
    """Let at most one address of a server be dead, or deaf, at a time; or none."""
    while not world.is_over:
        await asyncio.sleep(world.dice.uniform(0.0, _CHANGES_AFTER))
        away, is_deaf = world.dice.choice((*places, None)), world.dice.random() < 0.5
        for address, server in places.items():
            server.is_deaf = address == away and is_deaf
            if address == away and not is_deaf:
                bench.lines[address].pull("it is away")
            else:
                bench.lines[address].plug()


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = GatewayBench(CONFIG)
    async with keep_lines_open(bench.running):
        world = _World(bench, transactions, seed)
        changing, numbers = [], count()
        for at, server in enumerate(_SERVERS.values()):
            devices = {unit: world.device(unit, next(numbers)) for unit in range(1, 1 + server.units)}
            places = {
                to: FaultyServer(
                    world,
                    bench.lines.setdefault(to, MemoryLine(to, has_arrived=lambda: True)),
                    devices,
                    share=share,
                    seed=100 * seed + 10 * at + n,
                    manners=server.manners,
                )
                for n, to in enumerate(_addresses(at))
            }
            if len(places) > 1:
                changing.append(_keep_changing(world, bench, places))
            world.served |= {10 * at + unit: Served(device) for unit, device in devices.items()}
        clients = (keep_asking(world, bench.gateway, number, at_once=4, pause=0.1) for number in range(_CLIENTS))
        return await world.run(bench.events, *changing, *clients)
