"""The values of a virtual unit one after the other: which point each is here, and what the source calls it."""

import asyncio

import pytest

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.map_lines import map_lines
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

METER = """
[profile.meter]
points = [
  { name = "power", holding = 0, scale = 0.1, unit = "kW" },
  { name = "energy", holding = 1, type = "uint32", unit = "kWh" },
  { name = "on", coils = 3 },
]

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "meter", profile = "meter" }]

[[image]]
unit = 240
stale = "3 s"
"""


async def lines(config, span, **values):
    """Place, point, source, name there, text and state of each value; `values` are those of the meter by area."""
    async with gateway_bench(METER + config) as bench:
        meter = SimulatedDevice(1)
        for area, items in values.items():
            getattr(meter, area)[: len(items)] = items
        bench.attach("hall", SimulatedLine("rtu", meter))
        await asyncio.sleep(10)
        unit, points = bench.gateway.virtual[0].unit, bench.gateway.plan.points.get(240, ())
        found = map_lines(unit, points, span, asyncio.get_running_loop().time())
        return [(each.place, each.point.name, each.device, each.there, each.text, each.state) for each in found]


async def test_registers_of_a_range_are_told_by_the_points_in_it_and_one_by_one_where_there_is_none():
    config = 'map = [{ at = 10, device = "meter", holding = "0-4", every = "1 s" }]'
    assert await lines(config, Span(Area.HOLDING, 0, 400), holding=[125, 1, 2, 7, 8]) == [
        ("holding 10", "meter.power", "meter", "holding 0", "12.5", "fresh"),
        ("holding 11-12", "meter.energy", "meter", "holding 1-2", "65538", "fresh"),
        ("holding 13", "", "meter", "holding 3", "7", "fresh"),
        ("holding 14", "", "meter", "holding 4", "8", "fresh"),
    ]


@pytest.mark.parametrize(
    ("swap", "there"), [("words", [11, 10, 13, 12]), ("both", [11, 10, 13, 12]), ("bytes", [10, 11, 12, 13])]
)
async def test_registers_that_change_places_are_told_by_their_address_there(swap, there):
    config = f'map = [{{ at = 0, device = "meter", holding = "10-13", swap = "{swap}", every = "1 s" }}]'
    found = await lines(config, Span(Area.HOLDING, 0, 400), holding=[*range(14)])
    assert [each[3] for each in found] == [f"holding {each}" for each in there]
    assert [int(each[4]) for each in found] == [each << 8 if swap != "words" else each for each in there]


async def test_only_values_that_begin_in_the_window_are_told():
    rows = [f'{{ at = {each}, device = "meter", point = "energy", every = "1 s" }}' for each in (8, 10, 12)]
    config = f"map = [{', '.join(rows)}]"
    places = [each[0] for each in await lines(config, Span(Area.HOLDING, 9, 2))]
    assert places == ["holding 10-11"]
    config = 'map = [{ at = 10, device = "meter", holding = "20-29", every = "1 s" }]'
    places = [each[0] for each in await lines(config, Span(Area.HOLDING, 12, 3))]
    assert places == ["holding 12", "holding 13", "holding 14"]
    assert await lines(config, Span(Area.INPUT, 0, 400)) == []


async def test_with_a_profile_of_its_own_values_have_its_names_and_others_that_of_their_source():
    config = """
profile = "face"
holding = "30-31"
map = [
  { at = "total", device = "meter", point = "power", every = "1 s" },
  { at = 5, device = "meter", point = "power", every = "1 s" },
]

[profile.face]
points = [
  { name = "total", holding = 2, type = "float32", unit = "W", scale = 1000 },
  { name = "limit", holding = 31, unit = "A", write = true },
]
"""
    assert await lines(config, Span(Area.HOLDING, 0, 400), holding=[125]) == [
        ("holding 2-3", "total", "meter", "power", "12.5", "fresh"),
        ("holding 5", "", "meter", "power", "12.5", "fresh"),
        ("holding 31", "limit", "", "", "0", None),
    ]


async def test_coils_and_the_freshness_of_devices_as_coils():
    config = """
map = [
  { at = 0, area = "discrete", device = "meter", coils = "2-3", every = "1 s" },
  { at = 9, area = "discrete", fresh = ["meter"] },
]
"""
    assert await lines(config, Span(Area.DISCRETE, 0, 400), coils=[False, False, False, True]) == [
        ("discrete 0", "", "meter", "coils 2", "0", "fresh"),
        ("discrete 1", "meter.on", "meter", "coils 3", "1", "fresh"),
        ("discrete 9", "meter.fresh", "meter", "fresh", "1", None),
    ]
