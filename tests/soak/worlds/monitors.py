"""Monitor lines beside the client of a bus full of faults: what mirrors of them show was held by the device.

Both lines are in one gateway: the client line asks and writes, the monitor line hears what passes there. What is heard
is judged as any mirror. An acknowledged write may be missing for a moment: a frame that may go on is told after silence
only, and a write whose answer was damaged when its late window has ended.
"""

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Final

from gateway.devices.device import Device
from gateway.ports.port import OpenPort, SerialSettings
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import Fault, FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from kit.memory import MemoryLine
from soak.dated import CELLS, PAIRS, DatedDevice
from soak.dated_world import DatedWorld, keep_asking
from soak.judge import Served
from soak.tally import Tally
from soak.wires import FAULTS, Wire

_CLIENTS: Final = 10
_STALE: Final = 2.0
#: An acknowledged write is known within so many seconds.
_TOLD_WITHIN: Final = 1.0
#: The modes of the buses, with the units on each; a device is heard as a unit that is 30 more, and mirrored 100 more.
_UNITS: Final = {"rtu": (1, 2, 3), "ascii": (11, 12)}
_FORMATS: Final = {"rtu": "8E1", "ascii": "7E1"}
_HEARD, _MIRRORED = 30, 100
#: Values of two registers each: they are never put together out of two answers.
_POINTS: Final = ", ".join(
    f'{{ name = "{area}-{at}", {area} = {at}, type = "uint32" }}'
    for area in ("holding", "input")
    for at in range(0, CELLS, 2)
)
_FAULTS: Final = FAULTS | dict.fromkeys(
    (Fault.CUT, Fault.FLIPPED, Fault.NOISE_BEFORE, Fault.NOISE_BEHIND, Fault.NOISE_BETWEEN, Fault.HOLES), 1.0
)


def _bus(mode: str) -> str:
    """The tables of a bus: its client line, its monitor line, the mirrors of what is heard."""
    units = _UNITS[mode]
    heard = ", ".join(
        f'{{ unit = {unit % 10}, as = {unit + _HEARD}, name = "heard-{unit}", points = [{_POINTS}] }}' for unit in units
    )
    mirrors = "".join(
        f'[[image]]\nunit = {unit + _MIRRORED}\nof = "heard-{unit}"\nstale = "{_STALE:g} s"\n'
        f'read = [{{ holding = "0-{CELLS - 1}" }}, {{ input = "0-{2 * PAIRS - 1}" }}]\n'
        for unit in units
    )
    settings = f'mode = "{mode}"\nbaud = 38400\nformat = "{_FORMATS[mode]}"\nlatency = "5 ms"\n'
    return (
        f'[[line]]\nname = "{mode}"\nport = "/dev/{mode}"\n{settings}timeout = "50 ms"\n'
        f'devices = [{{ unit = "{units[0] % 10}-{units[-1] % 10}", as = "{units[0]}-{units[-1]}" }}]\n'
        f'[[line]]\nname = "heard-{mode}"\nport = "/dev/heard-{mode}"\n{settings}late_window = "400 ms"\n'
        f'role = "monitor"\ndevices = [{heard}]\n{mirrors}'
    )


CONFIG: Final = "".join(map(_bus, _UNITS))


class _TappedLine(MemoryLine):
    """A line that somebody else hears too: `heard`, a moment before its client does."""

    def __init__(self, name: str, latency: float, heard: MemoryLine) -> None:
        super().__init__(name, latency)
        self._heard = heard

    def deliver(self, data: bytes) -> None:
        self._heard.deliver(data)
        super().deliver(data)

    def take(self, data: bytes) -> None:
        self._heard.deliver(data)
        super().take(data)


class _Bench(GatewayBench):
    def _open(self, settings: SerialSettings) -> OpenPort:
        name = settings.port.removeprefix("/dev/")
        if name in _UNITS:
            heard = self.lines.setdefault(f"heard-{name}", MemoryLine(f"/dev/heard-{name}", settings.latency))
            self.lines.setdefault(name, _TappedLine(settings.port, settings.latency, heard))
        return super()._open(settings)


class _Heard(Served):
    """A mirror of what is heard of the device that others know as `asked`."""

    def __init__(self, asked: Served, now: Callable[[], float]) -> None:
        self.device = asked.device
        self.stale = _STALE
        self.parts = tuple(range(2, CELLS, 2))
        self._asked = asked
        self._now = now

    @property
    def written_at(self) -> list[float]:
        """Of each cell, when the last write was done that is known."""
        known = self._now() - _TOLD_WITHIN
        return [at if at < known else -inf for at in self._asked.written_at]


class _World(DatedWorld):
    """Shows the values of the devices that are heard."""

    bench: GatewayBench
    heard: dict[str, DatedDevice]

    def _written(self, device: DatedDevice | None) -> list[Sequence[float]]:
        """See DatedWorld."""
        units = self.units().values()
        return [each.written_at for each in units if each.device is device and isinstance(each, _Heard)]

    def shown(self) -> Iterator[tuple[Device, DatedDevice | None]]:
        """See DatedWorld."""
        for monitor in self.bench.gateway.monitors:
            for device in monitor.devices.values():
                yield device, self.heard[device.name]


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    bench = _Bench(CONFIG)
    async with keep_lines_open(bench.running):
        world = _World(transactions, seed)
        devices = {known_as: world.device(known_as % 10, known_as) for units in _UNITS.values() for known_as in units}
        world.bench, world.heard = bench, {f"heard-{unit}": device for unit, device in devices.items()}
        wires = []
        for at, (mode, units) in enumerate(_UNITS.items()):
            timing = LineTiming(mode, 38400, CharacterFormat.parse(_FORMATS[mode]))
            on_line = [devices[each] for each in units]
            faulty = FaultyLine(timing, *on_line, share=share, seed=10 * seed + at, faults=_FAULTS)
            wires.append(Wire(world, mode, bench.lines[mode], faulty))
        world.served = {unit: Served(device) for unit, device in devices.items()}
        world.served |= {unit + _MIRRORED: _Heard(asked, world.loop.time) for unit, asked in world.served.items()}
        clients = (keep_asking(world, bench.gateway, number, pause=0.05) for number in range(_CLIENTS))
        tally = await world.run(bench.events, *clients, *(wire.keep_pulling() for wire in wires))
        for name in (f"heard-{mode}" for mode in _UNITS):
            if bench.lines[name].written:
                tally.complain(f"something was written to {name}")
        return tally
