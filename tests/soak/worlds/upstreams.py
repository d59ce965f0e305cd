"""Units behind Modbus TCP servers that answer late, twice, never, in any order, mislabelled, and that hang up."""

from typing import Final

from kit.gateway_bench import GatewayBench, keep_lines_open
from soak.dated_world import DatedWorld, keep_asking
from soak.faulty_server import TIMEOUT, FaultyServer
from soak.judge import Served
from soak.tally import Tally

#: The name of each server, its units, and how many requests may be under way on it.
_SERVERS: Final = (("many", range(1, 7), 16), ("few", range(1, 3), 2), ("one", range(1, 2), 16))
_CLIENTS: Final = 12
CONFIG: Final = "".join(
    f"""
    [[upstream]]
    name      = "{name}"
    to        = "tcp://10.0.0.{at}:502"
    units     = [{{ as = "{10 * at + 1}-{10 * at + len(units)}", unit = "1-{len(units)}" }}]
    timeout   = "{1000 * TIMEOUT:g} ms"
    in_flight = {in_flight}
    """
    for at, (name, units, in_flight) in enumerate(_SERVERS)
)


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = GatewayBench(CONFIG)
    async with keep_lines_open(bench.running):
        world = DatedWorld(transactions, seed)
        for at, (name, units, _) in enumerate(_SERVERS):
            devices = {unit: world.device(unit, 10 * at + unit) for unit in units}
            line = bench.lines[f"tcp://10.0.0.{at}:502"]
            FaultyServer(world, line, devices, share=share, seed=10 * seed + at, knows_units=name != "one")
            world.served |= {10 * at + unit: Served(device) for unit, device in devices.items()}
        clients = (keep_asking(world, bench.gateway, number, at_once=4, pause=0.1) for number in range(_CLIENTS))
        return await world.run(bench.events, *clients)
