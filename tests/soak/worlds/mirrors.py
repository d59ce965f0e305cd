"""Mirrors of devices on lines full of faults and behind a server, with several writers, through them and past them."""

from itertools import pairwise
from typing import Final, NamedTuple

from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.dated_world import DatedWorld, keep_asking
from soak.faulty_server import FaultyServer
from soak.judge import Served
from soak.tally import Tally
from soak.wires import FAULTS, Wire

_CLIENTS: Final = 10
_LINES: Final = """
[[line]]
name    = "rtu"
port    = "/dev/rtu"
baud    = 38400
format  = "8E1"
latency = "5 ms"
timeout = "50 ms"
devices = [{ unit = "1-3" }]

[[line]]
name    = "ascii"
port    = "/dev/ascii"
mode    = "ascii"
baud    = 38400
format  = "7E1"
latency = "5 ms"
timeout = "50 ms"
retries = 1
devices = [{ unit = "1-2", as = "11-12" }]

[[upstream]]
name    = "server"
to      = "tcp://10.0.0.1:502"
units   = [{ as = "21-23", unit = "1-3" }]
timeout = "100 ms"
"""
_TIMINGS: Final = {
    "rtu": LineTiming("rtu", 38400, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 38400, CharacterFormat.parse("7E1")),
}
#: The units for clients of each line and of the server.
_UNITS: Final = {"rtu": (1, 2, 3), "ascii": (11, 12), "server": (21, 22, 23)}


class _Mirror(NamedTuple):
    """A mirror; what begins at another address is polled every so many seconds. Values may be `stale` seconds old."""

    unit: int
    of: str
    stale: float
    every: dict[int, float]

    @property
    def config(self) -> str:
        """Its table in the config file."""
        rows = ", ".join(
            f'{{ {area} = "{first}-{end - 1}", every = "{1000 * self.every[first]:g} ms" }}'
            for first, end in pairwise((*self.every, 8))
            for area in ("holding", "input")
        )
        stale = f"{1000 * self.stale:g} ms"
        return f'[[image]]\nunit = {self.unit}\nof = "{self.of}"\nstale = "{stale}"\nread = [{rows}]\n'


_MIRRORS: Final = (
    _Mirror(101, "rtu/1", 0.5, {0: 0.2}),
    _Mirror(102, "rtu/2", 1.0, {0: 0.2, 4: 0.4}),
    _Mirror(103, "rtu/3", 2.0, {0: 0.5, 4: 0.5}),
    _Mirror(111, "ascii/11", 0.8, {0: 0.3, 4: 0.2}),
    _Mirror(112, "ascii/12", 3.0, {0: 1.0}),
    _Mirror(121, "server/21", 0.5, {0: 0.1, 4: 0.2}),
    _Mirror(122, "server/22", 2.0, {0: 0.5}),
)
CONFIG: Final = _LINES + "".join(mirror.config for mirror in _MIRRORS)


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = GatewayBench(CONFIG)
    async with keep_lines_open(bench.running):
        world = DatedWorld(transactions, seed)
        devices = {known_as: world.device(known_as % 10, known_as) for units in _UNITS.values() for known_as in units}
        wires = []
        for at, (name, timing) in enumerate(_TIMINGS.items()):
            on_line = [devices[each] for each in _UNITS[name]]
            faulty = FaultyLine(timing, *on_line, share=share, seed=10 * seed + at, faults=FAULTS)
            wires.append(Wire(world, name, bench.lines[name], faulty))
        behind = {devices[each].unit: devices[each] for each in _UNITS["server"]}
        FaultyServer(world, bench.lines["tcp://10.0.0.1:502"], behind, share=share, seed=seed)
        world.served = {known_as: Served(device) for known_as, device in devices.items()} | {
            each.unit: Served(devices[each.unit - 100], each.stale, tuple(each.every)[1:]) for each in _MIRRORS
        }
        clients = (keep_asking(world, bench.gateway, number, pause=0.1) for number in range(_CLIENTS))
        return await world.run(bench.events, *clients, *(wire.keep_pulling() for wire in wires))
