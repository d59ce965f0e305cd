"""Programs that a gateway is a part of, beside clients over TCP: they ask by addresses and by points, and give up.

What a program gets is judged as what any client gets. A reading was held since the moment that it names. What a program
gives up while it waits is not done any more; each write is audited once, whatever has become of it.
"""

import asyncio
from collections.abc import Mapping
from typing import Final

from gateway.errors import RequestError
from gateway.library.reading import Reading
from gateway.library.unit_client import UnitClient
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import FaultyLine
from kit.gateway_bench import GatewayBench, keep_lines_open
from kit.program import unit_of
from soak.dated import Write
from soak.dated_world import DatedWorld, JudgingClient, keep_asking
from soak.judge import A_MOMENT, WRITE, WRITE_AND_READ, Served
from soak.tally import Tally
from soak.wires import FAULTS, Wire

_PROGRAMS: Final = 8
_CLIENTS: Final = 6
#: A program gives up this share of its requests, after so many seconds at most.
_GIVES_UP: Final = 0.3
_SOON: Final = 0.15
#: A request that has its turn is sent within so many seconds.
_PAUSE: Final = 0.02
#: So long, in seconds, an answer is on its way: its time limit.
_WAY: Final = 0.06
#: Nothing waits longer, in seconds.
_LONGEST: Final = 20.0
_TIMINGS: Final = {
    "rtu": LineTiming("rtu", 115200, CharacterFormat.parse("8E1")),
    "retries": LineTiming("rtu", 57600, CharacterFormat.parse("8E1")),
}
_MIRROR: Final = 101
_STALE: Final = 1.0
_AREAS: Final = {3: Area.HOLDING, 4: Area.INPUT}
#: Points that are read with one request each: of one register, and of four.
_POINTS: Final = ",".join(
    f'{{ name = "{area}-{at}-{items}", {area} = {at}, type = "uint{16 * items}"{more} }}'
    for area, more in (("holding", ", write = true"), ("input", ""))
    for items in (1, 4)
    for at in range(9 - items)
)
CONFIG: Final = f"[profile.all]\npoints = [{_POINTS}]\n" + "".join(
    f"""
    [[line]]
    name    = "{name}"
    port    = "/dev/{name}"
    baud    = {timing.baud}
    latency = "5 ms"
    retries = {int(name == "retries")}
    [[line.devices]]
    unit = "1-2"
    as = "{10 * at + 1}-{10 * at + 2}"
    name = "{name}-*"
    timeout = "50 ms"
    profile = "all"
    """
    for at, (name, timing) in enumerate(_TIMINGS.items())
)
CONFIG_OF_MIRROR: Final = f"""
    [[image]]
    unit  = {_MIRROR}
    of    = "rtu-1"
    read  = [{{ holding = "0-7", every = "300 ms" }}, {{ input = "0-7", every = "300 ms" }}]
    stale = "{1000 * _STALE:g} ms"
"""


class _World(DatedWorld):
    """The units as programs ask them, and what these have given up."""

    def __init__(self, goal: int, seed: int) -> None:
        super().__init__(goal, seed)
        self.bench = GatewayBench(CONFIG + CONFIG_OF_MIRROR)
        self.asked: dict[int, UnitClient] = {}
        self.writes_asked = 0
        #: Writes that were given up, and when.
        self.given_up: list[tuple[Write, float]] = []

    def connect(self, share: float, seed: int) -> None:
        """Connect the devices to the lines, which have been open once."""
        for at, (name, timing) in enumerate(_TIMINGS.items()):
            devices = {10 * at + unit: self.device(unit, 10 * at + unit) for unit in (1, 2)}
            faulty = FaultyLine(timing, *devices.values(), share=share, seed=10 * seed + at, faults=FAULTS)
            Wire(self, name, self.bench.lines[name], faulty)
            self.served |= {known_as: Served(device) for known_as, device in devices.items()}
        self.served[_MIRROR] = Served(self.served[1].device, _STALE)
        self.asked = {number: unit_of(self.bench, number) for number in self.served}

    def units(self) -> Mapping[int, Served]:
        return self.served

    def judge_in_the_end(self) -> None:
        """Look at all that was given up, and whether each write was audited."""
        for write, at in self.given_up:
            if write.done_at is not None and write.done_at > at + _PAUSE:
                self.tally.complain(f"{write.values} was given up at {at:.6f} s, and done at {write.done_at:.6f} s")
        audits = self.tally.events["write_audit"]
        if audits != self.writes_asked:
            self.tally.complain(f"{self.writes_asked} writes were asked for, and {audits} audited")


class _Client(JudgingClient):
    """A client over TCP."""

    async def _asks(self, unit: int, served: object, pdu: bytes) -> bytes:
        _count_write(self._world, pdu)
        return await super()._asks(unit, served, pdu)


class _Program(JudgingClient):
    """A part of the program that asks, and gives up now and then."""

    def _leave(self) -> None:
        """It is a part of the gateway's own program."""

    async def _asks(self, unit: int, served: object, pdu: bytes) -> bytes:
        """The response to a request; nothing if it was given up."""
        assert isinstance(served, Served)
        self._tally.questions += 1
        write, asked_at = self._own[unit][-1] if _count_write(self._world, pdu) else None, self._loop.time()
        patience = self._dice.uniform(0.0, _SOON) if self._dice.random() < _GIVES_UP else None
        try:
            async with asyncio.timeout(patience):
                response = await self._answer(self._world.asked[unit], served, pdu)
        except TimeoutError:
            self._tally.abandoned += 1
            if write is not None:
                self._world.given_up.append((write, self._loop.time()))
            return b""
        except RequestError as error:
            response = bytes((pdu[0] | EXCEPTION_BIT, error.code))
        self._tally.slowest = max(self._tally.slowest, self._loop.time() - asked_at)
        return response

    async def _answer(self, unit: UnitClient, served: Served, pdu: bytes) -> bytes:
        """The response to a request, made of what the program got."""
        function, first, words = pdu[0], int.from_bytes(pdu[1:3]), pdu[3:]
        way = self._dice.choice(("request", "addresses", "points"))
        if way == "request" or function == WRITE_AND_READ:
            return await unit.request(pdu)
        if function in _AREAS:
            return await self._values(unit, served, _AREAS[function], first, int.from_bytes(words), way == "points")
        values = [int.from_bytes(words[at : at + 2]) for at in range(0 if function == WRITE else 3, len(words), 2)]
        if way == "points" and len(values) == 1:
            await unit.write(f"holding-{first}-1", values[0])
        else:
            await unit.write_holding(first, values)
        return pdu[:5]

    async def _values(
        self, unit: UnitClient, served: Served, area: Area, first: int, items: int, by_point: bool
    ) -> bytes:
        if by_point and items in (1, 4):
            reading = await unit.read(f"{area}-{first}-{items}")
            data = int(reading.value or 0).to_bytes(2 * items)
            self._judge_age(served, area, first, data, reading)
        else:
            read = unit.read_holding if area is Area.HOLDING else unit.read_input
            data = b"".join(each.to_bytes(2) for each in await read(first, items))
        return bytes((3 if area is Area.HOLDING else 4, len(data))) + data

    def _judge_age(self, served: Served, area: Area, first: int, data: bytes, reading: Reading) -> None:
        """What was read was held since the time of the reading, but for the way of a device's answer."""
        words, now = [int.from_bytes(data[at : at + 2]) for at in range(0, len(data), 2)], self._loop.time()
        self._tally.counts["readings"] += 1
        self._tally.counts["readings of a mirror"] += served.stale is not None
        device, since = served.device, now - reading.age - (_WAY if served.stale is None else A_MOMENT)
        trouble = None if device is None else device.trouble(area, first, words, since, now)
        if trouble:
            self._tally.complain(f"at {now:.6f} s {reading} was {reading.age:.6f} s old: {trouble}")


def _count_write(world: DatedWorld, pdu: bytes) -> bool:
    """Count a write, if it is one."""
    assert isinstance(world, _World)
    is_write = pdu[0] not in _AREAS
    world.writes_asked += is_write
    return is_write


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    world = _World(transactions, seed)
    bench = world.bench
    async with keep_lines_open(bench.running):
        world.connect(share, seed)
        programs = (
            keep_asking(world, bench.gateway, each, at_once=3, writes=0.3, kind=_Program) for each in range(_PROGRAMS)
        )
        clients = (keep_asking(world, bench.gateway, 100 + each, kind=_Client) for each in range(_CLIENTS))
        tally = await world.run(bench.events, *programs, *clients)
        await asyncio.sleep(_LONGEST)
        tally.take_events(bench.events)
        world.judge_in_the_end()
        return tally
