"""Points are written as their config says: through a whole gateway, at what a device really holds afterwards."""

import asyncio

import pytest

from gateway.errors import DoesNotFit, ExceptionReceived, UnitFailed
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "boiler", profile = "boiler" }]

[[image]]
unit = 200
name = "desk"
holding = "0-19"
profile = "boiler"

[profile.boiler]
FUNCTIONS
points = [
    { name = "pump", holding = 8, bit = 3, write = true },
    { name = "mode", holding = 8, bits = "4-6", labels = { 0 = "off", 2 = "eco" }, write = true },
    { name = "step", holding = 8, byte = "high", type = "int8", write = true },
    { name = "flow", input = 12, type = "int16", scale = 0.1, offset = -40, write = true, write_at = 15 },
    { name = "limit", holding = 2, min = 10, max = 20, write = true, write_function = "multiple" },
    { name = "next", holding = 3, write = true },
    { name = "power", holding = 4, type = "int16", scale_from = "power-sf", write = true },
    { name = "power-sf", holding = 5, type = "int16" },
    { name = "count", holding = 6, type = "bcd32", swap = "words", write = true },
]
"""
MIRROR = """
[[image]]
unit = 241
name = "copy"
of = "boiler"
read = [{ holding = "0-9", every = "1 s" }]
"""


def config(functions: str = "") -> str:
    return CONFIG.replace("FUNCTIONS", functions)


@pytest.fixture
def device():
    device = SimulatedDevice(6)
    device.holding[8] = 0xA5A5
    device.holding[4:6] = [123, 0xFFFF]
    return device


@pytest.fixture
async def bench(device):
    async with gateway_bench(config()) as bench:
        bench.attach("hall", SimulatedLine("rtu", device))
        yield bench


@pytest.fixture
async def mirrored(device):
    async with gateway_bench(config() + MIRROR) as bench:
        bench.attach("hall", SimulatedLine("rtu", device))
        await asyncio.sleep(10)
        yield bench


def written(device) -> list[str]:
    """The writes that the device has heard."""
    return [frame.pdu.hex(" ").upper() for frame in device.heard if frame.pdu[0] in (5, 6, 15, 16, 22)]


async def write(bench, name: str, value: object, unit: int | str = "boiler"):
    (told,) = (await ask(bench.running, "write-point", unit=unit, name=name, values=[value]))["values"]
    return told


async def read(bench, name: str, unit: int | str = "boiler"):
    (told,) = (await ask(bench.running, "point", unit=unit, name=name))["values"]
    return told


@pytest.mark.parametrize(
    ("functions", "request_pdu"),
    [
        ("", "06 00 08 A5 AD"),
        ("functions = [3, 4, 16]", "10 00 08 00 01 02 A5 AD"),
        ("functions = [3, 4, 6, 16, 22]", "16 00 08 FF F7 00 08"),
    ],
)
async def test_one_bit_is_written_as_the_device_can_and_the_others_stay(device, functions, request_pdu):
    async with gateway_bench(config(functions)) as bench:
        bench.attach("hall", SimulatedLine("rtu", device))
        told = await write(bench, "pump", "on")
        assert (told.value, told.registers, told.bits) == (1, [], (3, 3))
        assert written(device) == [request_pdu]
        assert device.holding[8] == 0xA5AD
        assert (await read(bench, "pump")).registers == [0xA5AD]


async def test_writers_of_one_register_undo_nothing_of_each_other(bench, device):
    device.delay = 0.1
    names = {"pump": True, "mode": "eco", "step": -2}
    await asyncio.gather(*(write(bench, name, value) for name, value in names.items()))
    assert device.holding[8] == 0xFEAD
    values = [(await read(bench, name)).value for name in names]
    assert values == [1, "eco", -2]


async def test_bits_of_an_image_are_written_and_the_others_stay(bench):
    await write(bench, "step", -1, "desk")
    await write(bench, "mode", "eco", "desk")
    assert (await read(bench, "step", "desk")).registers == [0xFF20]


async def test_bits_are_written_through_a_mirror(mirrored, device):
    await write(mirrored, "mode", "off", "copy")
    assert device.holding[8] == 0xA585
    await asyncio.sleep(3)
    assert (await read(mirrored, "mode", "copy")).value == "off"


async def test_bits_that_cannot_be_read_are_not_written(bench, device):
    device.refuses[3] = 4
    with pytest.raises(ExceptionReceived, match="exception 04"):
        await write(bench, "pump", "on")
    assert written(device) == []


async def test_a_value_is_written_somewhere_else_than_it_is_read(bench, device):
    told = await write(bench, "flow", -37.5)
    assert (told.value, told.area, told.address, told.registers) == (-37.5, "holding", 15, [25])
    assert device.holding[15] == 25
    assert (await read(bench, "flow")).area == "input"


async def test_the_scale_of_the_moment_counts(bench, device):
    await write(bench, "power", 12.5)
    assert device.holding[4] == 125
    device.holding[5] = 1
    await write(bench, "power", 120)
    assert device.holding[4] == 12
    assert (await read(bench, "power")).value == 120
    with pytest.raises(DoesNotFit, match="125 is not a multiple of 10, the scale of power"):
        await write(bench, "power", 125)
    device.holding[5] = 0x8000
    with pytest.raises(DoesNotFit, match="the device has no scale for power now"):
        await write(bench, "power", 120)
    assert (await read(bench, "power")).value is None
    device.silent = True
    with pytest.raises(UnitFailed):
        await write(bench, "power", 120)
    assert len(written(device)) == 2


async def test_limits_and_functions_are_those_of_the_point(bench, device):
    await write(bench, "limit", 20)
    assert written(device) == ["10 00 02 00 01 02 00 14"]
    for value in (9, 21):
        with pytest.raises(DoesNotFit, match="limit must be"):
            await write(bench, "limit", value)
    assert len(written(device)) == 1
    await write(bench, "count", 12345678)
    assert device.holding[6:8] == [0x5678, 0x1234]


async def test_plain_points_side_by_side_are_one_request_and_others_are_refused(bench, device):
    pair = [{"point": "next", "value": 7}, {"point": "limit", "value": 12}]
    told = (await ask(bench.running, "write-points", unit=46, values=pair))["values"]
    assert [(each.point, each.value) for each in told] == [("next", 7), ("limit", 12)]
    assert written(device) == ["10 00 02 00 02 04 00 0C 00 07"]
    pair = [{"point": "pump", "value": 1}, {"point": "mode", "value": "eco"}]
    with pytest.raises(DoesNotFit, match="bits of a register are written alone"):
        await ask(bench.running, "write-points", unit=46, values=pair)
    assert len(written(device)) == 1


async def test_new_bits_are_shown_at_once_where_values_are_shared(bench, device):
    told = await ask(bench.running, "points", unit=46)
    assert {each.point: each.value for each in told["values"]}["pump"] == 0
    await write(bench, "pump", 1)
    told = await ask(bench.running, "points", unit=46, max_age=60)
    assert {each.point: each.value for each in told["values"]}["pump"] == 1


@pytest.mark.parametrize(
    ("addresses", "names"),
    [("0-4", ["limit", "next"]), ("4-7", ["power", "power-sf", "count"]), ("8-8", ["pump", "mode", "step"])],
)
async def test_points_of_an_image_are_those_whose_registers_and_scale_it_has(addresses, names):
    async with gateway_bench(config().replace('"0-19"', f'"{addresses}"')) as bench:
        told = (await ask(bench.running, "unit", unit="desk"))["unit"].points
        assert [each.name for each in told] == names


async def test_a_request_in_one_turn_is_one_of_function_22(bench, device):
    told = await ask(bench.running, "request", unit=46, pdu="16 00 08 FF F7 00 08", in_one_turn=16)
    assert (told["pdu"], written(device)) == ("16 00 08 FF F7 00 08", ["10 00 08 00 01 02 A5 AD"])
    assert (told["sent"][:26], told["received"][:17]) == ("06 10 00 08 00 01 02 A5 AD", "06 10 00 08 00 01")
    for pdu, function in (("06 00 08 00 01", 6), ("16 00 08 FF F7 00 08", 5)):
        with pytest.raises(Exception, match='"in_one_turn"'):
            await ask(bench.running, "request", unit=46, pdu=pdu, in_one_turn=function)
