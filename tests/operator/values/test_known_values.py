"""What is known of the points of devices out of what passes anyway. In virtual time."""

import asyncio
from dataclasses import asdict

import pytest

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.operation import Asker as Door
from gateway.operator.operator import Operator
from gateway.operator.units.units import points_within
from gateway.operator.values.known_values import known_points
from gateway.operator.values.passed import passed
from gateway.operator.values.requests import AT_CONTROL
from gateway.profiles.point import NO_VALUE
from gateway.request import Caller
from kit.asker import Asker
from kit.asking import NO_FILE, answers, pictured
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[profile.meter]
points = [
  { name = "power", holding = 0, type = "int32", unit = "kW", scale = 0.1, decimals = 1 },
  { name = "state", holding = 2, labels = { 1 = "running" } },
  { name = "energy", holding = 10, type = "uint32", scale_from = "energy-sf" },
  { name = "energy-sf", holding = 13, type = "int16" },
  { name = "alarm", coils = 3 },
  { name = "flow", input = 5, invalid = 0x8000 },
  { name = "limit", holding = 2, write = true, write_at = 30 },
  { name = "reset", holding = 40, write = "only" },
]

[[line]]
name = "hall"
port = "/dev/hall"
devices = [
  { unit = 1, name = "meter", profile = "meter" },
  { unit = 2, name = "other", profile = "meter" },
  { unit = 6, name = "press" },
]
"""


def attached(bench):
    devices = {unit: SimulatedDevice(unit) for unit in (1, 2, 6)}
    bench.attach("hall", SimulatedLine("rtu", *devices.values()))
    return devices


async def values(bench, unit="meter"):
    (answer,) = await answers(bench.running, {"verb": "values", "unit": unit})
    return {each.point: asdict(each) for each in answer["values"] if each.name == unit}


async def states(bench):
    return {point: each["state"] for point, each in (await values(bench)).items()}


async def asked(bench, pdu, unit=1):
    (answer,) = await answers(bench.running, {"verb": "request", "unit": unit, "pdu": pdu})
    return answer["pdu"]


async def test_a_clients_read_tells_all_points_that_it_has_whole():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)[1].holding[:3] = [0, 1234, 1]
        await asked(bench, "03 00 00 00 03")
        await asyncio.sleep(2)
        found = await values(bench)
        power = found["power"]
        assert (power["value"], power["text"], power["measure"], power["registers"]) == (
            123.4,
            "123.4",
            "kW",
            [0, 1234],
        )
        assert (power["state"], power["source"], power["unit"]) == ("fresh", "control", 1)
        assert power["age_ms"] == pytest.approx(2000, abs=50)
        assert power["time"].endswith("Z")
        assert (found["state"]["value"], found["state"]["state"]) == ("running", "fresh")
        energy = found["energy"]
        assert (energy["state"], energy["value"], energy["text"], energy["age_ms"]) == ("never", None, NO_VALUE, None)
        assert "reset" not in found


async def test_a_value_needs_all_registers_of_one_answer_with_those_of_its_scale():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)[1].holding[10:14] = [0, 77, 0, 0xFFFF]
        await asked(bench, "03 00 0A 00 02")
        await asked(bench, "03 00 0D 00 01")
        assert (await values(bench))["energy"]["state"] == "never"
        await asked(bench, "03 00 0A 00 04")
        assert (await values(bench))["energy"]["value"] == 7.7


async def test_coils_no_value_and_another_device():
    async with gateway_bench(CONFIG) as bench:
        device = attached(bench)[1]
        device.coils[3], device.input[5] = True, 0x8000
        await asked(bench, "01 00 00 00 08")
        await asked(bench, "04 00 05 00 01")
        found = await values(bench)
        assert (found["alarm"]["value"], found["alarm"]["registers"]) == (1, [])
        assert (found["flow"]["state"], found["flow"]["value"]) == ("invalid", None)
        assert {each["state"] for each in (await values(bench, "other")).values()} == {"never"}


async def test_the_newest_read_counts_whichever_it_is():
    async with gateway_bench(CONFIG) as bench:
        device = attached(bench)[1]
        await asked(bench, "03 00 02 00 01")
        device.holding[2] = 5
        await asked(bench, "03 00 00 00 14")
        assert (await values(bench))["limit"]["value"] == 5
        device.holding[2] = 6
        await asked(bench, "03 00 02 00 01")
        assert (await values(bench))["limit"]["value"] == 6


async def test_what_only_clients_read_is_stale_after_a_minute():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)
        await asked(bench, "03 00 00 00 03")
        await asyncio.sleep(59)
        assert (await states(bench))["power"] == "fresh"
        await asyncio.sleep(2)
        assert (await states(bench))["power"] == "stale"


async def test_what_is_polled_is_stale_after_three_intervals():
    mirror = '[[image]]\nunit = 100\nname = "copy"\nof = "meter"\nread = [{ holding = "0-2", every = "5 s" }]\n'
    async with gateway_bench(CONFIG + mirror) as bench:
        device = attached(bench)[1]
        await asyncio.sleep(12)
        power = (await values(bench))["power"]
        assert (power["state"], power["source"], power["stale_ms"]) == ("fresh", "mirror copy", 15_000)
        device.silent = True
        await asyncio.sleep(14)
        assert (await states(bench))["power"] == "stale"


async def test_of_several_polls_the_shortest_interval_counts():
    mirror = '[[image]]\nunit = {}\nof = "meter"\nread = [{{ holding = "0-{}", every = "{} s" }}]\n'
    async with gateway_bench(
        CONFIG + mirror.format(11, 2, 5) + mirror.format(12, 1, 2) + mirror.format(13, 3, 30)
    ) as bench:
        attached(bench)
        found = await values(bench)
        assert [found[name]["stale_ms"] for name in ("power", "state", "alarm")] == [6_000, 15_000, 60_000]


@pytest.mark.parametrize("silent", [False, True])
async def test_after_a_write_the_value_before_it_is_stale(silent):
    async with gateway_bench(CONFIG) as bench:
        device = attached(bench)[1]
        await asked(bench, "03 00 00 00 03")
        device.silent = silent
        await asked(bench, "06 00 02 00 09")
        found = await states(bench)
        assert (found["state"], found["power"]) == ("stale", "stale")  # of one read
        device.silent = False
        await asyncio.sleep(5)
        await asked(bench, "03 00 00 00 03")
        assert (await values(bench))["limit"]["value"] == 9
        assert (await states(bench))["limit"] == "fresh"


async def test_the_age_is_from_the_first_sending_of_a_read_that_is_sent_again():
    """The answer may be to the first one: a device that slept is asked twice."""
    async with gateway_bench(
        CONFIG.replace("[profile.meter]", '[profile.meter]\ntimeout = "200 ms"\nwake = "1 s"')
    ) as bench:
        device = attached(bench)[1]
        await asyncio.sleep(5)
        device.script.append([])
        begin = bench.gateway.lines[0].now()
        await asked(bench, "03 00 00 00 03")
        took = bench.gateway.lines[0].now() - begin
        assert took > 0.2
        assert len(device.heard) == 2
        assert (await values(bench))["power"]["age_ms"] == pytest.approx(1000 * took, abs=20)


async def test_after_a_broadcast_and_a_write_by_another_name_the_value_before_it_is_stale():
    twice = CONFIG.replace("  { unit = 2, ", '  { unit = 1, as = 101, name = "again" },\n  { unit = 2, ')
    async with gateway_bench(twice) as bench:
        attached(bench)
        line, client = bench.gateway.lines[0], Asker()
        await asked(bench, "03 00 00 00 03")
        line.every_device.submit(client.ask("06 00 02 00 09", unit=0, now=line.now()), line.now())
        await asyncio.sleep(1)
        assert client.answers == [None]
        assert (await states(bench))["state"] == "stale"
        await asked(bench, "03 00 00 00 03")
        assert (await values(bench))["limit"]["value"] == 9
        assert (await states(bench))["state"] == "fresh"
        await asked(bench, "06 00 02 00 08", unit=101)
        assert (await states(bench))["state"] == "stale"


async def test_an_exception_and_a_refused_read_tell_nothing():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)[1].refuses[3] = 2
        assert await asked(bench, "03 00 00 00 03") == "83 02"
        assert set((await states(bench)).values()) == {"never"}


async def test_a_reload_keeps_what_is_the_same_device_and_decodes_it_anew():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)[1].holding[:3] = [0, 1234, 1]
        await asked(bench, "03 00 00 00 03")
        await bench.reload(CONFIG.replace("scale = 0.1", "scale = 0.01").replace("decimals = 1", "decimals = 2"))
        assert (await values(bench))["power"]["text"] == "12.34"


async def test_a_reload_that_makes_the_registers_wider_drops_the_values():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)
        await asked(bench, "03 00 00 00 03")
        wide = '[profile.meter]\nwide = "all"\npoints = [{ name = "power", holding = 0, type = "uint32" }]\n'
        await bench.reload(wide + CONFIG[CONFIG.index("[[line]]") :])
        assert (await values(bench))["power"]["state"] == "never"


@pytest.mark.parametrize(
    ("old", "new"), [('port = "/dev/hall"', 'port = "/dev/other"'), ("unit = 1, name", "unit = 11, as = 1, name")]
)
async def test_a_reload_that_makes_it_another_device_drops_the_values(old, new):
    async with gateway_bench(CONFIG) as bench:
        attached(bench)
        await asked(bench, "03 00 00 00 03")
        await bench.reload(CONFIG.replace(old, new))
        assert (await states(bench))["power"] == "never"


async def test_a_reload_amid_a_look_at_values_spoils_neither_this_one_nor_later_ones():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)
        operator, asker = Operator(bench.running, None), Door(AT_CONTROL, lambda: True)
        before = pictured(bench.running, 1)
        renamed = CONFIG.replace('"meter", profile', '"twin", profile').replace("holding = 0,", "holding = 1,")
        await bench.reload(renamed)
        assert list(known_points(operator, before, asker)) == []
        await asked(bench, "03 00 00 00 02", unit="twin")
        assert "power" in {point.name for point in points_within(operator, before, Span(Area.HOLDING, 0, 1))}
        known = {each.point.name: each for each in known_points(operator, pictured(bench.running, 1), asker)}
        assert known["power"].read is None


async def test_who_may_not_read_an_area_sees_no_value_of_it():
    access = '[[access]]\nlisten = ["control"]\nfunctions = [4]\nunits = 1\n'
    async with gateway_bench(CONFIG + access) as bench:
        attached(bench)
        assert list(await values(bench)) == ["flow"]
        assert await values(bench, "other") == {}


async def test_without_any_point_a_hint_says_how_to_get_some():
    config = '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 6, name = "press" }]\n'
    async with gateway_bench(config) as bench:
        attached(bench)
        await asked(bench, "03 00 00 00 03", unit=6)
        (answer,) = await answers(bench.running, {"verb": "values"})
        assert answer["values"] == []
        assert "profile list" in answer["hint"]
        assert "import csv" in answer["hint"]
        assert all(device.last_reads is None for line in bench.running.gateway.lines for device in line.all_devices)


async def test_of_a_device_without_points_the_registers_that_passed_last_are_found():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)[6].holding[7:9] = [5, 9]
        for pdu in ("03 00 00 00 03", "03 00 07 00 02", "06 00 03 00 01", "03 00 00 00 03"):
            await asked(bench, pdu, unit=6)
            await asyncio.sleep(1)
        operator = Operator(bench.running, NO_FILE)
        asker = Door(Caller.without_address("web"), lambda: True)
        found = await passed(operator, pictured(bench.running, "press"), asker)
        assert [(each.span.start, each.items.hex()) for each in found] == [
            (0, "000000000001"[:4] + "00000000"),
            (7, "00050009"),
        ]
        assert found[0].span.area is Area.HOLDING
        assert found[0].age < found[1].age
        await bench.reload(CONFIG.replace("unit = 6,", "unit = 7, as = 6,"))
        assert await passed(operator, pictured(bench.running, "press"), asker) == []


async def test_who_may_not_read_an_area_does_not_see_what_passed():
    async with gateway_bench(f"{CONFIG}[[access]]\nlisten = ['web']\nfunctions = [4]\n") as bench:
        attached(bench)
        for pdu in ("03 00 00 00 03", "04 00 00 00 03"):
            await asked(bench, pdu, unit=6)
        asker, press = Door(AT_CONTROL, lambda: True, "10.0.0.9", "web"), pictured(bench.running, "press")
        found = await passed(Operator(bench.running, NO_FILE), press, asker)
        assert [each.span.area for each in found] == [Area.INPUT]


async def test_a_read_that_came_while_values_are_told_is_not_younger_than_now():
    async with gateway_bench(CONFIG) as bench:
        attached(bench)
        await asked(bench, "03 00 00 00 03")
        unit, operator = pictured(bench.running, "meter"), Operator(bench.running, NO_FILE)
        known, *_ = known_points(operator, unit, Door(Caller.without_address("control"), lambda: True))
        assert known.age(now=0.0) == 0.0
