"""Writers among readers on busy lines: equal reads share a transaction, and show what was acknowledged before them."""

from typing import Final

from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.dated_world import DatedWorld, keep_asking
from soak.judge import Served
from soak.tally import Tally
from soak.wires import FAULTS, Wire

#: A writer has four requests under way, a reader two.
_WRITERS: Final = 3
_READERS: Final = 30
_TIMINGS: Final = {
    "rtu": LineTiming("rtu", 115200, CharacterFormat.parse("8E1")),
    "retries": LineTiming("rtu", 57600, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 57600, CharacterFormat.parse("7E1")),
}
_UNITS: Final = (1, 2)
CONFIG: Final = "".join(
    f"""
    [[line]]
    name    = "{name}"
    port    = "/dev/{name}"
    mode    = "{timing.mode}"
    baud    = {timing.baud}
    format  = "{timing.format}"
    latency = "5 ms"
    timeout = "50 ms"
    retries = {int(name == "retries")}
    devices = [{{ unit = 1, as = {10 * at + 1} }}, {{ unit = 2, as = {10 * at + 2}, priority = "high" }}]
    """
    for at, (name, timing) in enumerate(_TIMINGS.items())
)


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = GatewayBench(CONFIG)
    async with keep_lines_open(bench.running):
        world = DatedWorld(transactions, seed)
        for at, (name, timing) in enumerate(_TIMINGS.items()):
            devices = {10 * at + unit: world.device(unit, 10 * at + unit) for unit in _UNITS}
            faulty = FaultyLine(timing, *devices.values(), share=share, seed=10 * seed + at, faults=FAULTS)
            Wire(world, name, bench.lines[name], faulty)
            world.served |= {known_as: Served(device) for known_as, device in devices.items()}
        writers = (
            keep_asking(world, bench.gateway, each, at_once=4, writes=0.8, pause=0.001) for each in range(_WRITERS)
        )
        readers = (keep_asking(world, bench.gateway, 100 + each, writes=0.0) for each in range(_READERS))
        return await world.run(bench.events, *writers, *readers)
