"""Devices without a unit for clients: the listener for their line leads to them by address, all other doors by name."""

import asyncio
import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass

import pytest

from gateway.errors import WrongQuestion
from gateway.events import AccessDenied, WriteAudit
from gateway.fleet.subjects import Asked, asked_by
from gateway.runtime.fleet.presence import served_units
from gateway.trace.records import Sent
from kit.asking import ask
from kit.broker import FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

LISTEN = """
[[listen]]
name  = "scada"
bind  = "tcp://0.0.0.0:502"
unit0 = "broadcast"

[[listen]]
name  = "hall port"
bind  = "tcp://0.0.0.0:503"
line  = "hall"
unit0 = "broadcast"

[[listen]]
name  = "yard port"
bind  = "tcp://0.0.0.0:504"
line  = "yard"
"""
SCADA, HALL, YARD = range(3)
#: Each device has its line and address in register 0: see `furnish`.
LINES = """
[[line]]
name    = "hall"
port    = "/dev/hall"
wire    = "direct"
rest    = "1 s"
devices = [
  { unit = 1, as = "none", name = "first" },
  { unit = "2-4", as = "none", name = "hall-*", points = [{ name = "place", holding = 0, write = true }] },
  { unit = 5, as = 41, name = "numbered" },
]

[[line]]
name    = "yard"
port    = "/dev/yard"
wire    = "direct"
rest    = "1 s"
devices = [{ unit = "1-5", as = "none" }]
"""
MIRROR = """
[[image]]
unit = 241
of   = "hall-3"
read = [{ holding = "0-1", every = "500 ms" }]
"""
CONFIG = LISTEN + LINES
ALL_NUMBERED = CONFIG.replace('"1-5", as = "none"', '"1-5", as = "101-105"').replace(', as = "none"', "")
HALL_ALONE = CONFIG.partition('[[line]]\nname    = "yard"')[0].replace("as = 41", 'as = "none"')
HALL_ALONE = HALL_ALONE.replace('[[listen]]\nname  = "yard port"\nbind  = "tcp://0.0.0.0:504"\nline  = "yard"\n', "")
ALL = '[[access]]\nallow = ["read", "write"]\n'
READ, WRITE = "03 0000 0001", "06 0001 0007"
PLACES = {"hall": 100, "yard": 200}


def furnish(bench: GatewayBench) -> dict[str, dict[int, SimulatedDevice]]:
    """Five devices on each line, which tell where they are: 103 is address 3 of the hall."""
    there = {}
    for line, place in PLACES.items():
        devices = {unit: SimulatedDevice(unit, delay=0.002) for unit in range(1, 6)}
        for unit, device in devices.items():
            device.holding[0] = place + unit
        bench.attach(line, SimulatedLine("rtu", *devices.values()))
        there[line] = devices
    return there


def answer(place: int) -> str:
    return f"03 02 {place:04X}".replace(f"{place:04X}", f"{place >> 8:02X} {place & 255:02X}")


async def by_name(bench: GatewayBench, name: str, pdu: str = READ) -> str:
    return str((await ask(bench.running, "request", unit=name, pdu=pdu))["pdu"])


async def test_its_listener_leads_to_it_by_address_and_commands_by_name() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        furnish(bench)
        for listener, line in ((HALL, "hall"), (YARD, "yard")):
            client = bench.client(listener=listener)
            assert [await client.asks(unit, READ) for unit in range(1, 6)] == [
                answer(PLACES[line] + unit) for unit in range(1, 6)
            ]
        names = {"first": 101, "hall-2": 102, "hall-4": 104, "numbered": 105, "yard/1": 201, "yard/5": 205}
        assert {name: await by_name(bench, name) for name in names} == {
            name: answer(place) for name, place in names.items()
        }


async def test_no_other_listener_leads_to_it() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        there = furnish(bench)
        client = bench.client(listener=SCADA)
        assert {await client.asks(unit, READ) for unit in range(1, 256) if unit != 41} == {"83 0A"}
        assert all(not device.heard for device in (*there["hall"].values(), *there["yard"].values()))


async def test_a_gateway_has_more_of_them_than_there_are_units() -> None:
    names = [f"line-{number}" for number in range(5)]
    config = "".join(
        f'[[listen]]\nbind = "tcp://0.0.0.0:{510 + at}"\nline = "{name}"\n' for at, name in enumerate(names)
    )
    config += "".join(
        f'[[line]]\nname = "{name}"\nport = "/dev/{name}"\nwire = "direct"\n'
        'devices = [{ unit = "1-240", as = "none" }]\n'
        for name in names
    )
    async with gateway_bench(config + ALL) as bench:
        for at, name in enumerate(names):
            device = SimulatedDevice(240)
            device.holding[0] = at
            bench.attach(name, SimulatedLine("rtu", device))
        for at, name in enumerate(names):
            assert await bench.client(listener=at).asks(240, READ) == answer(at)
            assert await by_name(bench, f"{name}/240") == answer(at)
        units = (await ask(bench.running, "units"))["units"]
        assert len({unit.name for unit in units}) == len(units) == 1200
        assert {unit.unit for unit in units} == {None}


# Rights


@pytest.mark.parametrize(
    ("rows", "at_hall", "named"),
    [
        pytest.param(ALL, [1, 2, 5], ["first", "numbered"], id="all"),
        pytest.param('[[access]]\nunits = [1, 2]\nallow = ["write"]\n', [], [], id="no unit of theirs"),
        pytest.param('[[access]]\nunits = "1-247"\nallow = ["write"]\n', [1, 2, 5], ["first", "numbered"], id="1-247"),
        pytest.param('[[access]]\nunits = 41\nallow = ["write"]\n', [5], ["numbered"], id="the one with a unit"),
        pytest.param('[[access]]\nunits = 2\nallow = ["read"]\n' + ALL, [1, 2, 5], ["first", "numbered"], id="not 2"),
        pytest.param('[[access]]\nlisten = ["hall port"]\nunits = 1\nallow = ["write"]\n', [1], [], id="by address"),
        pytest.param(
            '[[access]]\nlisten = ["hall port"]\nunits = 1\nallow = ["read"]\n' + ALL,
            [2, 5],
            ["first", "numbered"],
            id="but address 1",
        ),
    ],
)
async def test_who_may_write_where(rows: str, at_hall: list[int], named: list[str]) -> None:
    async with gateway_bench(CONFIG + rows) as bench:
        furnish(bench)
        client = bench.client("10.0.0.9:1", host="10.3.0.1", listener=HALL)
        written = [unit for unit in (1, 2, 5) if await client.asks(unit, WRITE) == "06 00 01 00 07"]
        assert written == at_hall
    last = '[[access]]\nlisten = ["control"]\nunits = 9\nallow = ["read"]\n'
    async with gateway_bench(CONFIG + rows + last) as bench:
        furnish(bench)
        answers = {name: await by_name(bench, name, WRITE) for name in ("first", "numbered")}
        assert [name for name, pdu in answers.items() if pdu == "06 00 01 00 07"] == named


@pytest.mark.parametrize(
    ("listener", "config", "is_let"),
    [
        pytest.param(SCADA, ALL_NUMBERED, True, id="to devices with units"),
        pytest.param(SCADA, CONFIG, False, id="to some without"),
        pytest.param(HALL, HALL_ALONE.replace(', as = "none"', ""), True, id="to a line with units"),
        pytest.param(HALL, HALL_ALONE, False, id="to a line without"),
    ],
)
async def test_rows_for_some_units_do_not_let_a_broadcast_to_it(listener: int, config: str, is_let: bool) -> None:
    rows = '[[access]]\nunits = "1-100"\nallow = ["write"]\n[[access]]\nunits = "101-247"\nallow = ["write"]\n'
    async with gateway_bench(config + rows) as bench:
        bench.client("10.0.0.9:1", host="10.3.0.1", listener=listener).ask(0, WRITE)
        await asyncio.sleep(1.0)
        denied = [event.unit for event in bench.events if isinstance(event, AccessDenied)]
        assert denied == ([] if is_let else [0])


# What is told


async def test_events_and_the_trace_have_its_address_and_its_name() -> None:
    rows = '[[access]]\nlisten = ["control"]\nfunctions = [3, 6]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        there = furnish(bench)
        assert await by_name(bench, "hall-3", WRITE) == "06 00 01 00 07"
        assert await by_name(bench, "hall-3", "05 0001 FF00") == "85 01"
        there["hall"][3].is_silent = True
        [audit, refused] = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.unit, audit.device, audit.result, audit.listener) == (3, "hall-3", "ok", "control")
        assert (refused.unit, refused.device, refused.result) == (3, "hall-3", "denied")
        [denied] = [event for event in bench.events if isinstance(event, AccessDenied)]
        assert (denied.unit, denied.device) == (3, "hall-3")
        facts = (await ask(bench.running, "trace", unit="hall-3"))["facts"]
        assert {(fact["unit"], fact["name"]) for fact in facts} == {(3, "hall-3")}


async def test_failures_and_the_doctor_have_its_name() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        there = furnish(bench)
        there["hall"][3].silent = True
        assert await by_name(bench, "hall-3") == "83 0B"
        found = await ask(bench.running, "why", who="hall-3")
        [story] = found["stories"]
        assert found["unit"] is None
        assert (story["unit"], story["name"], story["result"]) == (3, "hall-3", "timeout")
        examined = await ask(bench.running, "doctor", line="hall", ask=False)
        assert "hall-3" in {finding.about for finding in examined["findings"]}


async def test_numbers_never_stand_where_it_has_none() -> None:
    """What stands in their place inside the gateway is shown nowhere."""
    async with gateway_bench(CONFIG + MIRROR + ALL + SELF) as bench:
        furnish(bench)
        for name in ("first", "hall-3", "yard/1"):
            await by_name(bench, name)
            await by_name(bench, name, WRITE)
        told = [await ask(bench.running, verb) for verb in ("status", "units", "trace", "doctor")]
        told.append(await ask(bench.running, "points", unit="hall-3"))
        told.append(await ask(bench.running, "unit", unit="first"))
        told.append(await ask(bench.running, "times", unit="first"))
        assert max(numbers_about_units([*told, *bench.events])) <= 255


SELF = "[self]\nunit = 246\n"


def numbers_about_units(told: object) -> Iterator[int]:
    """Yield the whole numbers that a part of this has for a unit."""
    if is_dataclass(told) and not isinstance(told, type):
        told = {field.name: getattr(told, field.name) for field in fields(told)}
    if isinstance(told, Mapping):
        yield from (each for key, each in told.items() if key in ("unit", "on_the_wire") and isinstance(each, int))
        told = [*told.values()]
    if isinstance(told, list | tuple):
        for each in told:
            yield from numbers_about_units(each)


# Reloads


async def test_a_reload_that_removes_another_one_gives_none_its_requests() -> None:
    """Its line and the other lines go on, what waits included: no number moves from one device to another."""
    fewer = CONFIG.replace('  { unit = 1, as = "none", name = "first" },\n', "")
    async with gateway_bench(CONFIG + MIRROR + ALL) as bench:
        there = furnish(bench)
        await asyncio.sleep(3.0)
        _, yard = bench.gateway.lines
        waiting = [asyncio.create_task(by_name(bench, f"yard/{unit}")) for unit in range(1, 6)]
        await asyncio.sleep(0)
        await bench.reload(fewer + MIRROR + ALL)
        assert [await each for each in waiting] == [answer(200 + unit) for unit in range(1, 6)]
        assert bench.gateway.lines[1] is yard, "the other line is the same one"
        await asyncio.sleep(2.0)
        assert {name: await by_name(bench, name) for name in ("hall-2", "hall-3", "yard/5")} == {
            "hall-2": answer(102),
            "hall-3": answer(103),
            "yard/5": answer(205),
        }
        assert await bench.client(listener=SCADA).asks(241, READ) == answer(103)
        with pytest.raises(WrongQuestion, match='nothing has the name "first"'):
            await by_name(bench, "first")
        assert not [frame for frame in there["hall"][1].heard if frame.pdu[0] == 6]


async def test_a_device_may_get_a_unit_and_lose_it() -> None:
    numbered = CONFIG.replace('{ unit = 1, as = "none", name = "first" }', '{ unit = 1, as = 7, name = "first" }')
    async with gateway_bench(CONFIG + ALL) as bench:
        furnish(bench)
        client = bench.client(listener=SCADA)
        assert await client.asks(7, READ) == "83 0A"
        await bench.reload(numbered + ALL)
        assert (await client.asks(7, READ), await by_name(bench, "first")) == (answer(101), answer(101))
        await bench.reload(CONFIG + ALL)
        assert (await client.asks(7, READ), await by_name(bench, "first")) == ("83 0A", answer(101))


# Other doors


async def test_a_mirror_leads_to_it() -> None:
    async with gateway_bench(CONFIG + MIRROR + ALL) as bench:
        there = furnish(bench)
        await asyncio.sleep(3.0)
        client = bench.client(listener=SCADA)
        assert await client.asks(241, READ) == answer(103)
        assert await client.asks(241, WRITE) == "06 00 01 00 07"
        assert there["hall"][3].holding[1] == 7


async def test_other_sites_ask_by_numbers_and_so_not_for_it() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        assert sorted(served_units(bench.gateway, bench.running.add_ons.fleet.router)) == [41]
    assert asked_by("mbgw.here.unit.255.from.there", "here") == Asked(255, "there")
    assert asked_by("mbgw.here.unit.256.from.there", "here") is None


MQTT = '[mqtt]\nbroker = "mqtt://b"\nwrite = true\npublish = [{ device = "hall-*", every = "500 ms" }]\n'


async def test_its_points_are_published_and_written_by_its_name() -> None:
    async with gateway_bench('site = "plant"\n' + CONFIG + MQTT + ALL) as bench:
        there = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        await asyncio.sleep(2.0)
        said = broker.said()
        places = {unit: json.loads(broker.retained[f"modbus/plant/hall-{unit}"])["place"] for unit in (2, 3, 4)}
        assert places == {2: 102, 3: 103, 4: 104}, said
        broker.send("modbus/plant/hall-3/place/set", "9")
        await asyncio.sleep(0.3)
        assert broker.said()["modbus/plant/hall-3/place/result"] == {"value": "9", "result": "ok"}
        assert {unit: device.holding[0] for unit, device in there["hall"].items()} == {
            1: 101,
            2: 102,
            3: 9,
            4: 104,
            5: 105,
        }
        [audit] = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.listener, audit.unit, audit.device) == ("mqtt", 3, "hall-3")
        records = [each for each in bench.running.ring.after(0) if isinstance(each, Sent)]
        assert {(each.unit, each.name) for each in records} == {(unit, f"hall-{unit}") for unit in (2, 3, 4)}


async def test_a_reload_publishes_no_device_as_another_one() -> None:
    config = 'site = "plant"\n' + CONFIG + MQTT + ALL
    async with gateway_bench(config) as bench:
        furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(1.0)
        broker.connect()
        await bench.reload(config.replace('{ unit = "2-4"', '{ unit = "3-4"'))
        said = broker.send("modbus/plant/hall-2/place/set", "9")
        assert said["modbus/plant/hall-2/place/result"] == {"value": "9", "result": "failed", "reason": "no such unit"}
        assert [event.result for event in bench.events if isinstance(event, WriteAudit)] == ["no_route"]
