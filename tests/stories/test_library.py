"""Each shipped profile: checked, simulated, and read, written, published and scanned through a whole gateway.

What is wrong here is a profile: a point that its own functions or addresses forbid, limits that no value keeps to, an
identity that another kind has too. That its registers are those of the device, only its document can say.
"""

import asyncio
import json

import pytest

from gateway.config.load import parse
from gateway.config.reading.profile_file import shipped_profile
from gateway.config.schema.profile import ProfileTable
from gateway.profiles import shipped_names
from gateway.profiles.point import Point
from gateway.registers.items import has_bits
from gateway.simulator.described import kind_of
from gateway.simulator.point_values import encoded, put
from gateway.simulator.profiled import Kind, Profiled
from gateway.timing.characters import Mode
from kit.asking import answers, ask
from kit.broker import FakeBroker
from kit.gateway_bench import GatewayBench, gateway_bench

NAMES = shipped_names()
#: The address on the line, and the one that clients use.
UNIT, CLIENT_UNIT = 1, 41
SITE = 'site = "plant"\n'
MQTT = '[mqtt]\nbroker = "mqtt://broker"\npublish = [{ device = "device", every = "1 s" }]\n'


def config_of(name: str, mode: Mode, more: str = "") -> str:
    device = f'{{ unit = {UNIT}, as = {CLIENT_UNIT}, name = "device", profile = "{name}" }}'
    line = f'[[line]]\nname = "hall"\nport = "/dev/hall"\nmode = "{mode}"\ndevices = [{device}]\n'
    return f"{SITE if more else ''}{line}\n{more}"


def table_of(name: str) -> ProfileTable:
    file = shipped_profile(name)
    assert file is not None
    assert file.table is not None, [str(problem) for problem in file.problems]
    return file.table


class Played:
    """A simulated device of a shipped profile, and the gateway that asks it."""

    def __init__(self, name: str, bench: GatewayBench, kind: Kind) -> None:
        self.name = name
        self.bench = bench
        self.kind = kind
        self.mode: Mode = kind.mode or "rtu"
        self.device = Profiled(UNIT, kind)
        bench.attach_at_pace("hall", self.device, mode=self.mode)

    @property
    def readable(self) -> list[Point]:
        return [point for point in self.kind.points if point.write != "only"]

    def held(self, point: Point) -> object:
        """The value of a point in the device."""
        return point.value(self.device.items(point.read_span))

    async def read(self) -> dict[str, object]:
        """What the gateway reads of all points, by name."""
        told = await ask(self.bench.running, "points", unit=CLIENT_UNIT, max_age=0)
        assert told.get("errors") is None
        return {each.point: each.value for each in told["values"]}


class Library:
    """`async with Library(name) as played`"""

    def __init__(self, name: str, more: str = "") -> None:
        self._name, self._kind = name, kind_of(name, table_of(name))
        self._bench = gateway_bench(config_of(name, self._kind.mode or "rtu", more))

    async def __aenter__(self) -> Played:
        return Played(self._name, await self._bench.__aenter__(), self._kind)

    async def __aexit__(self, *what: object) -> None:
        await self._bench.__aexit__(*what)


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_config_with_it_has_no_problem(name: str) -> None:
    mode = table_of(name).mode or "rtu"
    loaded = parse(config_of(name, mode), port_trouble=lambda port: None, real_path=lambda port: port)
    assert [str(problem) for problem in loaded.problems] == []


async def test_all_points_are_read_by_name_and_plausible(name: str) -> None:
    async with Library(name) as played:
        await asyncio.sleep(100)
        if not played.readable:
            return
        values = await played.read()
        for point in played.readable:
            value = values[point.name]
            assert value == played.held(point), point.name
            assert value is not None, f"{point.name} has no value"
            if point.minimum is not None and not isinstance(value, str):
                assert value >= point.minimum, point.name
            if point.maximum is not None and not isinstance(value, str):
                assert value <= point.maximum, point.name
            if point.labels:
                assert value in point.labels.values(), point.name


async def test_what_is_written_is_read_back(name: str) -> None:
    async with Library(name) as played:
        if played.kind.profile.quirks:
            return  # what is written may be its address: its own tests write that
        for point in played.kind.points:
            for text in other_values(played, point) if point.write != "no" else ():
                await ask(played.bench.running, "write-point", unit=CLIENT_UNIT, name=point.name, values=[text])
                assert text in (str(played.held(point)), point.show(played.held(point))), point.name
                if point.write == "yes":
                    told = await ask(played.bench.running, "point", unit=CLIENT_UNIT, name=point.name)
                    assert told["values"][0].value == played.held(point), point.name


def other_values(played: Played, point: Point) -> list[str]:
    """Values that can be written to a point, in addition to the one that it has."""
    if point.labels:
        return list(point.labels.values())
    if point.type == "string":
        return ["A", ""]
    if has_bits(point.area) or point.is_bit:
        return ["1", "0"]
    before = played.device.items(point.read_span)
    present = played.held(point)
    assert isinstance(present, int | float), point.name
    own = encoded(point, present * 1.05 + 1, 0, before)
    return [str(point.value(put(point, own, before)))]


async def test_a_scan_names_it(name: str) -> None:
    async with Library(name) as played:
        identity = played.kind.profile.identity
        device = Profiled(9, played.kind)
        played.bench.attach_at_pace("hall", played.device, device, mode=played.mode)
        told = await answers(played.bench.running, {"verb": "scan", "line": "hall", "units": "9"})
        (found,) = told[-1]["found"]
        if identity is not None:
            # Models are told apart by where they are, too; of registers with one value all kinds are named.
            alike = [each for each in shipped_names() if shipped_profile(each).table.identity == identity]
            assert found.profile.split(", ") == ([name] if identity.sunspec else alike)
            assert [model.model for model in found.models] == list(identity.sunspec)


async def test_all_points_are_published(name: str) -> None:
    if not table_of(name).points:
        return
    async with Library(name, MQTT) as played:
        broker = FakeBroker.of(played.bench)
        await asyncio.sleep(10.0)
        broker.connect()
        told = json.loads(broker.retained["modbus/plant/device"])
        assert told.keys() == {"time", *(point.name for point in played.readable)}
        assert [name for name, value in told.items() if value is None] == []
