"""Points near each other are read in one request, whoever reads them; and what a device refuses to be read so."""

from asyncio import sleep
from json import loads

import pytest

from gateway.events import PollRefused
from gateway.images.polling import TOGETHER_AGAIN
from gateway.images.polls import Poll, joined
from gateway.modbus.codes import Area
from gateway.profiles.holes import Holes
from gateway.profiles.read_rules import NO_RULES
from kit.asking import ask
from kit.broker import FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.shipped import shipped_points, shipped_text

#: Every third register of a meter has a meaning: 0, 3, 6, ... 27; it holds its address.
POINTS = "\n".join(f'  {{ name = "p{at}", holding = {at} }},' for at in range(0, 30, 3))
CONFIG = f"""
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
timeout = "100 ms"
devices = [{{ unit = 1, as = 41, name = "meter", profile = "meter" }}]

[profile.meter]
timeout = "100 ms"
max_gap = 2
points  = [
{POINTS}
]
"""
MQTT = """
[mqtt]
broker  = "mqtt://broker"
publish = [{ device = "meter", every = "1 s" }]
"""
OTHER_LINE = """
[[line]]
name = "other"
port = "/dev/other"
devices = [{ unit = 1, as = 51 }]
"""
PLACES = ", ".join(f'"{at}-{at}"' for at in range(0, 30, 3))
MIRROR = f"""
[[image]]
unit  = 241
name  = "copy"
of    = "meter"
stale = "4 s"
read  = [{{ holding = [{PLACES}], every = "1 s" }}]
"""
VALUES = {f"p{at}": at for at in range(0, 30, 3)}
ALL = "holding 0-27"


def furnish(bench, *absent):
    meter = SimulatedDevice(1, delay=0.002)
    meter.holding = list(range(200))
    meter.absent = {(Area.HOLDING, address) for address in absent}
    bench.attach("hall", SimulatedLine("rtu", meter))
    return meter


def reads(device):
    """The reads that came since the last call, as ranges of addresses, in their order."""
    heard = [frame.pdu for frame in device.heard]
    device.heard.clear()
    spans = [(int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")) for pdu in heard]
    return [f"holding {start}-{start + count - 1}" if count > 1 else f"holding {start}" for start, count in spans]


async def values(bench):
    told = await ask(bench.running, "points", unit=41)
    return {each.point: each.value for each in told["values"]}


async def test_all_points_of_a_meter_are_one_request():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench)
        assert await values(bench) == VALUES
        assert reads(meter) == [ALL]


METER = """
[[line]]
name    = "cabinet"
port    = "/dev/cabinet"
baud    = 9600
format  = "8N1"
devices = [{ unit = 1, as = 41, name = "meter", profile = "own" }]

"""


@pytest.mark.parametrize(
    ("profile", "allows", "before", "after"),
    [("eastron-sdm630", "", 15, 4), ("eastron-sdm120", "max_gap = 10", 11, 4)],
)
async def test_all_measured_values_of_a_meter_are_a_few_requests(profile, allows, before, after):
    """The document of the SDM120 promises nothing about what lies between: a copy of its profile does."""
    points = [point for point in shipped_points(profile) if point.area is Area.INPUT]
    assert len([*joined(map(Poll.of, points), NO_RULES, Holes())]) == before
    own = shipped_text(profile).replace(f"[profile.{profile}]", f"[profile.own]\n{allows}")
    async with gateway_bench(METER + own) as bench:
        meter = SimulatedDevice(1, items=0x10000)
        bench.attach("cabinet", SimulatedLine("rtu", meter))
        assert len(await values(bench)) == len(shipped_points(profile))
        functions = [frame.pdu[0] for frame in meter.heard]
        assert functions.count(4) == after


RESET = '{ name = "reset", holding = 13, write = "only" }'


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("points  = [", f"points  = [{RESET},"),
        ('profile = "meter" }', f'profile = "meter", points = [{RESET}] }}'),
    ],
    ids=["of the profile", "of the device"],
)
async def test_nobody_reads_a_register_that_is_only_written(before, after):
    config = CONFIG.replace(before, after)
    async with gateway_bench(config + MQTT + MIRROR) as bench:
        meter = furnish(bench)
        FakeBroker.of(bench)
        await sleep(3.0)
        assert await values(bench) == VALUES
        assert set(reads(meter)) == {"holding 0-12", "holding 15-27"}


async def test_without_max_gap_each_is_a_request_of_its_own():
    async with gateway_bench(CONFIG.replace("max_gap = 2", "max_gap = 1")) as bench:
        meter = furnish(bench)
        assert await values(bench) == VALUES
        assert len(reads(meter)) == 10


async def test_an_operator_gets_all_values_of_a_meter_that_refuses_a_hole_and_the_next_read_does_not_try_again():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, 13)
        assert await values(bench) == VALUES
        first = reads(meter)
        assert first[0] == ALL
        assert await values(bench) == VALUES
        second = reads(meter)
        assert len(second) < len(first)
        assert second == ["holding 0-12", "holding 15-27"]


@pytest.mark.parametrize("code", [2, 3, 4])
async def test_all_exceptions_by_which_devices_refuse_addresses_make_a_read_smaller(code):
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, 13)
        meter.code_of_absent = code
        assert await values(bench) == VALUES
        reads(meter)
        assert await values(bench) == VALUES
        assert reads(meter) == ["holding 0-12", "holding 15-27"]


async def test_a_meter_that_refuses_every_hole_is_read_point_by_point_from_the_second_read_on():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, *(at for at in range(30) if at % 3))
        assert await values(bench) == VALUES
        assert len(reads(meter)) == 19
        assert await values(bench) == VALUES
        assert len(reads(meter)) == 10


async def test_a_point_that_is_missing_costs_the_others_nothing_but_requests():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, 15)
        for _ in range(2):
            told = await ask(bench.running, "points", unit=41)
            assert {each.point: each.value for each in told["values"]} == {
                name: value for name, value in VALUES.items() if name != "p15"
            }
            assert [(each.address, each.exception) for each in told["errors"]] == [(15, 2)]
            assert len(reads(meter)) < 11, "fewer than point by point"


async def test_what_is_published_survives_a_refused_hole_and_nobody_is_told():
    async with gateway_bench(CONFIG + MQTT) as bench:
        meter = furnish(bench, 13)
        broker = FakeBroker.of(bench)
        await sleep(0.5)
        broker.connect()
        assert broker.said() == {}
        assert bench.gateway.plan.mqtt.devices[0].points[0].every == 1.0
        assert content_of(broker) == VALUES
        assert reads(meter)[0] == ALL
        await sleep(10.0)
        assert set(reads(meter)) == {"holding 0-12", "holding 15-27"}
        assert not [event for event in bench.events if isinstance(event, PollRefused)]
        await sleep(2 * TOGETHER_AGAIN)
        assert set(reads(meter)) == {"holding 0-12", "holding 15-27"}, "not even then"


async def test_a_published_point_that_is_missing_parts_the_others_no_more_than_needed_until_it_is_there():
    async with gateway_bench(CONFIG + MQTT) as bench:
        meter = furnish(bench, 15)
        broker = FakeBroker.of(bench)
        await sleep(3.0)
        broker.connect()
        assert content_of(broker) == {name: value for name, value in VALUES.items() if name != "p15"}
        (told,) = (event for event in bench.events if isinstance(event, PollRefused))
        assert (told.device, told.addresses, told.code) == ("meter", "holding 15", 2)
        meter.absent.clear()
        await sleep(2 * TOGETHER_AGAIN)
        reads(meter)
        await sleep(5.0)
        assert set(reads(meter)) == {ALL}
        broker.take()
        assert content_of(broker) == VALUES


async def test_what_one_has_found_out_the_others_know_also_after_a_reload():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, 13)
        await values(bench)
        reads(meter)
        longer = CONFIG.replace("devices = [", 'devices = [{ unit = 9, as = 49, name = "new" }, ')
        await bench.reload(longer + MQTT + MIRROR)
        meter = furnish(bench, 13)
        await sleep(3.0)
        FakeBroker.of(bench)
        await sleep(3.0)
        assert set(reads(meter)) == {"holding 0-12", "holding 15-27"}


async def test_another_device_under_the_same_name_is_tried_anew():
    async with gateway_bench(CONFIG) as bench:
        meter = furnish(bench, 13)
        await values(bench)
        await bench.reload(CONFIG.replace("max_gap = 2", "max_gap = 3"))
        meter = furnish(bench)
        await values(bench)
        assert reads(meter) == [ALL]


async def test_a_mirror_polls_over_holes_and_clients_read_declared_addresses_only():
    async with gateway_bench(CONFIG + MIRROR) as bench:
        meter = furnish(bench)
        await sleep(5.0)
        assert set(reads(meter)) == {ALL}
        client = bench.client()
        assert await client.asks(241, "03 0003 0001") == "03 02 00 03"
        assert await client.asks(241, "03 0004 0001") == "83 02"
        assert await client.asks(241, "03 0003 0004") == "83 02"


async def test_a_mirror_of_a_meter_that_refuses_a_hole_has_all_values_and_says_nothing():
    async with gateway_bench(CONFIG + MIRROR) as bench:
        meter = furnish(bench, 13)
        await sleep(5.0)
        reads(meter)
        await sleep(70.0)
        assert set(reads(meter)) == {"holding 0-12", "holding 15-27"}
        client = bench.client()
        for at in range(0, 30, 3):
            assert await client.asks(241, f"03 00{at:02X} 0001") == f"03 02 00 {at:02X}"
        assert not [event for event in bench.events if isinstance(event, PollRefused)]


def content_of(broker):
    """What the broker keeps of the meter."""
    told = loads(broker.retained["modbus/plant/meter"])
    del told["time"]
    return told
