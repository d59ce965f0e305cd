"""Writers of single bits: registers of devices without function 22, on lines, behind a server, through a mirror."""

from typing import Final

from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import Fault, FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from kit.memory import MemoryLine
from soak.bits import REGISTERS, BitsDevice, BitsServer, keep_writing_all, keep_writing_bits
from soak.dated_world import DatedWorld
from soak.tally import Tally
from soak.wires import Wire

#: The bits of each register that have a writer.
_BITS: Final = (0, 7, 15)
_FAULTS: Final = dict.fromkeys((Fault.LATE, Fault.LATE_EXCEPTION, Fault.EXCEPTION, Fault.SILENT), 2.0) | dict.fromkeys(
    (Fault.CUT, Fault.FLIPPED, Fault.DUPLICATE), 1.0
)
_TIMINGS: Final = {
    "rtu": LineTiming("rtu", 115200, CharacterFormat.parse("8E1")),
    "retries": LineTiming("rtu", 57600, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 57600, CharacterFormat.parse("7E1")),
}
_UNITS: Final = (1, 2)
#: Behind the mirror of rtu/1, and behind the server.
_MIRROR: Final = 101
_SERVED: Final = (51, 52)
CONFIG: Final = (
    "".join(
        f"""
    [[line]]
    name    = "{name}"
    port    = "/dev/{name}"
    mode    = "{timing.mode}"
    baud    = {timing.baud}
    format  = "{timing.format}"
    latency = "5 ms"
    timeout = "50 ms"
    rest    = "off"
    retries = {int(name == "retries")}
    devices = [{{ unit = "1-2", as = "{10 * at + 1}-{10 * at + 2}" }}]
    """
        for at, (name, timing) in enumerate(_TIMINGS.items())
    )
    + f"""
    [[upstream]]
    name      = "server"
    to        = "tcp://10.0.0.5:502"
    units     = [{{ as = "{_SERVED[0]}-{_SERVED[-1]}", unit = "1-2" }}]
    timeout   = "100 ms"
    rest      = "off"
    retries   = 1

    [[image]]
    unit = {_MIRROR}
    of   = "rtu/1"
    read = [{{ holding = "0-3", every = "200 ms" }}]
    """
)


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = GatewayBench(CONFIG)
    async with keep_lines_open(bench.running):
        world = DatedWorld(transactions, seed)
        devices: dict[int, BitsDevice] = {}
        beside = []
        for at, (name, timing) in enumerate(_TIMINGS.items()):
            of_line = [BitsDevice(unit, 10 * at + unit, world) for unit in _UNITS]
            faulty = FaultyLine(timing, *of_line, share=share, seed=10 * seed + at, faults=_FAULTS)
            beside.append(Wire(world, name, bench.lines[name], faulty).keep_pulling())
            devices |= {device.number: device for device in of_line}
        behind = {unit: BitsDevice(unit, known_as, world) for unit, known_as in enumerate(_SERVED, 1)}
        line = bench.lines.setdefault("tcp://10.0.0.5:502", MemoryLine("server", has_arrived=lambda: True))
        BitsServer(world, line, behind, share, seed)
        devices |= {device.number: device for device in behind.values()}
        router = bench.gateway.listeners[0].router
        for unit, device in devices.items():
            beside.append(keep_writing_all(world, router, unit, device, pause=0.1))
            for register in REGISTERS:
                for bit in _BITS:
                    through = _MIRROR if unit == 1 and bit else unit
                    beside.append(keep_writing_bits(world, router, through, device, register, bit))
        return await world.run(bench.events, *beside)
