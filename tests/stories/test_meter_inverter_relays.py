"""An energy meter, a solar inverter and a relay board on one RTU line, as shipped profiles describe them."""

import asyncio

import pytest

from gateway.errors import ExceptionReceived
from gateway.profiles.point import Point
from kit.asking import ask
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.shipped import shipped_points

CONFIG = """
[[line]]
name    = "cabinet"
port    = "/dev/cabinet"
devices = [
  { unit = 1, name = "meter",    profile = "eastron-sdm630" },
  { unit = 2, name = "inverter", profile = "growatt-mid" },
  { unit = 3, name = "relays",   profile = "waveshare-relay-d" },
]
"""
PROFILES = {"meter": "eastron-sdm630", "inverter": "growatt-mid"}


def number(index: int) -> int:
    """Make a value that differs for each point, and that each type can have."""
    return 1 + index


def fill(device: SimulatedDevice, profile: str) -> dict[str, int | str]:
    """Give each point of a device a value of its own; return what has to be read."""
    values: dict[str, int | str] = {}
    for index, point in enumerate(shipped_points(profile)):
        value = next(iter(point.labels.values()), None) or number(index)
        values[point.name] = value
        put(device, point, str(value))
    return values


def put(device: SimulatedDevice, point: Point, text: str) -> None:
    items = point.items(text)
    registers = [int.from_bytes(items[at : at + 2], "big") for at in range(0, len(items), 2)]
    getattr(device, point.area)[point.address : point.address + point.count] = registers


def attach(bench: GatewayBench) -> tuple[SimulatedDevice, SimulatedDevice, SimulatedDevice]:
    devices = SimulatedDevice(1, items=500), SimulatedDevice(2, items=500), SimulatedDevice(3)
    bench.attach("cabinet", SimulatedLine("rtu", *devices))
    return devices


async def read(bench: GatewayBench, unit: str) -> dict[str, int | float | str | None]:
    told = await ask(bench.running, "points", unit=unit)
    return {value.point: value.value for value in told["values"]}


async def test_all_points_of_all_are_read_by_their_names_at_the_same_time() -> None:
    async with gateway_bench(CONFIG) as bench:
        meter, inverter, _ = attach(bench)
        expected = [fill(meter, PROFILES["meter"]), fill(inverter, PROFILES["inverter"])]
        assert list(await asyncio.gather(read(bench, "meter"), read(bench, "inverter"))) == expected


async def test_a_relay_is_switched_by_its_name() -> None:
    async with gateway_bench(CONFIG) as bench:
        *_, board = attach(bench)
        await ask(bench.running, "write-point", unit="relays", name="relay-2", values=[1])
        assert board.coils[:8] == [False, True, False, False, False, False, False, False]
        assert await bench.client().asks(3, "01 0000 0008") == "01 01 02"


async def test_an_inverter_that_falls_asleep_disturbs_neither_of_the_others() -> None:
    """At night it answers too late, when the meter has been asked for something else."""
    async with gateway_bench(CONFIG) as bench:
        meter, inverter, board = attach(bench)
        expected = fill(meter, PROFILES["meter"])
        inverter.script.append([Answer(1.05, bytes.fromhex("02 04 02 00 01 3C F0"))])
        asleep = asyncio.create_task(ask(bench.running, "point", unit="inverter", name="status"))
        of_meter = asyncio.create_task(read(bench, "meter"))
        await ask(bench.running, "write-point", unit="relays", name="relay-1", values=[1])
        with pytest.raises(ExceptionReceived):
            await asleep
        assert await of_meter == expected
        assert board.coils[0]


@pytest.mark.parametrize(("unit", "points", "requests"), [("meter", 83, 4), ("inverter", 39, 1)])
async def test_many_points_are_few_requests(unit: str, points: int, requests: int) -> None:
    """Without the gaps that their documents allow it would be 15 and 8."""
    async with gateway_bench(CONFIG) as bench:
        meter, inverter, _ = attach(bench)
        asked = {"meter": meter, "inverter": inverter}[unit]
        fill(asked, PROFILES[unit])
        assert (len(await read(bench, unit)), len(asked.heard)) == (points, requests)
