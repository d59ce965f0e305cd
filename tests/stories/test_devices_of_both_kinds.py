"""A device on a line and one behind another server are the same to operators, programs and brokers. In virtual time."""

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import asdict

import pytest

from gateway.config.reading.source import place_of
from gateway.errors import WrongQuestion
from gateway.modbus.rtu import with_crc
from gateway.operator.status.metrics import read
from gateway.operator.trace.capture import packets
from gateway.operator.trace.selection import lines
from gateway.operator.units.answer_times import answer_times
from gateway.plant.discovery import Discovery
from gateway.plant.topics import Topics
from gateway.runtime.tightness import ENOUGH, STEP, TightLimits
from kit.asking import ask, pictured
from kit.broker import FakeBroker
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.statuses import status

DEVICES = """
[[{rows}]]
unit = 1
as = 37
name = "inverter"
profile = "inverter"
priority = "high"
points = [{{ name = "limit", holding = 20, write = true }}]
[[{rows}]]
unit = 2
as = 38
name = "meter"
timeout = "300 ms"
"""
LINE = '[[line]]\nname = "roof"\nport = "/dev/roof"\nbaud = 115200\n' + DEVICES.format(rows="line.devices")
UPSTREAM = '[[upstream]]\nname = "roof"\nto = "tcp://10.1.0.5"\n' + DEVICES.format(rows="upstream.units")
OWNERS = {"line": LINE, "upstream": UPSTREAM}
CONFIG = """
site = "plant"

[profile.inverter]
title = "An inverter"
functions = [3, 4, 6]
holding = "0-99"
input = "0-99"
timeout = "200 ms"
points = [
  { name = "power", holding = 0, type = "int16", unit = "W" },
  { name = "energy", input = 2, type = "uint32", unit = "Wh" },
  { name = "state", holding = 8, labels = { 0 = "off", 1 = "on" } },
]
"""
MIRROR = """
[[image]]
unit = 241
name = "mirrored"
of = "inverter"
read = [{ holding = "0-9", every = "500 ms" }]
stale = "2 s"
"""
MQTT = """
[mqtt]
broker  = "mqtt://broker"
write   = true
publish = [{ device = "inverter", every = "1 s" }]
"""


@pytest.fixture(params=OWNERS)
def kind(request):
    return request.param


@asynccontextmanager
async def both(kind, config=CONFIG):
    async with gateway_bench(config + OWNERS[kind]) as bench:
        devices = SimulatedDevice(1), SimulatedDevice(2)
        if kind == "line":
            bench.attach("roof", SimulatedLine("rtu", *devices))
        else:
            bench.attach_server("tcp://10.1.0.5:502", *devices)
        yield bench, *devices


def shown(told):
    """What is told, as programs get it."""
    return json.loads(json.dumps(told, default=asdict))


async def test_it_is_read_and_written_by_name_and_by_its_points(kind):
    async with both(kind) as (bench, inverter, _):
        inverter.holding[0], inverter.holding[8], inverter.input[2:4] = 0xFFFE, 1, [1, 2]
        points = await ask(bench.running, "points", unit="inverter")
        assert [(each["point"], each["value"]) for each in shown(points["values"])] == [
            ("power", -2),
            ("energy", 65538),
            ("state", "on"),
            ("limit", 0),
        ]
        (power,) = shown((await ask(bench.running, "point", unit="inverter", name="power"))["values"])
        assert power["value"] == -2
        await ask(bench.running, "write-point", unit="inverter", name="limit", values=[7])
        assert inverter.holding[20] == 7
        told = await ask(bench.running, "read", unit="inverter", area="holding", start=19, end=20)
        assert [each["value"] for each in shown(told["values"])] == [0, 7]


async def test_it_is_described_alike():
    described = []
    for kind in OWNERS:
        async with both(kind) as (bench, *_):
            described.append(shown((await ask(bench.running, "unit", unit="inverter"))["unit"]))
    on_line, behind = described
    assert [on_line.pop("longest_wait_ms"), behind.pop("longest_wait_ms")] == pytest.approx([2200, 2200], abs=40)
    assert [on_line.pop("kind"), behind.pop("kind")] == ["device", "upstream"]
    assert on_line == behind


async def test_its_row_of_the_status_says_the_same(kind):
    async with both(kind) as (bench, inverter, meter):
        client = bench.client()
        assert await client.asks(37, "03 00 00 00 01") == "03 02 00 00"
        inverter.refuses[6] = 4
        assert await client.asks(37, "06 00 14 00 01") == "86 04"
        meter.silent = True
        for _ in range(3):
            assert await client.asks(38, "03 00 00 00 01") == "83 0B"
            await asyncio.sleep(1.0)
        assert await client.asks(38, "03 00 00 00 01") == "83 0B"
        first, second = status(bench.running).units
        assert (first.line, first.unit, first.on_the_wire, first.name, first.profile) == (
            ("roof", 37, 1, "inverter", "inverter")
        )  # fmt: skip
        assert (first.state, first.counts.ok, first.counts.exception, first.exceptions) == ("fine", 1, 1, {4: 1})
        assert 5 <= first.times.answer_p50_ms <= 15
        assert 200 <= first.times.limit_ms <= 215
        assert (second.state, second.failures, second.counts.timeout, second.counts.resting) == ("resting", 3, 3, 1)


async def test_the_trace_names_it_and_says_why_a_request_failed(kind):
    async with both(kind) as (bench, _, meter):
        client = bench.client()
        await client.asks(37, "03 00 00 00 02")
        meter.silent = True
        await client.asks(38, "03 00 00 00 01")
        page = await ask(bench.running, "trace", unit="inverter", after=0)
        (told,) = [each for each in page["facts"] if each["kind"] == "exchange"]
        assert (told["line"], told["unit"], told["address"], told["name"]) == ("roof", 37, 1, "inverter")
        assert (told["request"], told["response"]) == ("03 00 00 00 02", "03 04 00 00 00 00")
        assert 200 <= told["limit_ms"] <= 215
        (story,) = (await ask(bench.running, "why", who="meter"))["stories"]
        assert (story["name"], story["result"]) == ("meter", "timeout")


async def test_a_late_response_is_in_the_trace_and_in_a_capture(kind):
    async with both(kind) as (bench, _, meter):
        meter.delay = 0.4
        await bench.client().asks(38, "03 00 00 00 01")
        await asyncio.sleep(0.5)
        facts = shown((await ask(bench.running, "trace", unit="meter", after=0))["facts"])
        (late,) = [each for each in facts if each["kind"] == "heard"]
        assert (late["line"], late["owner"], late["frame"]) == ("roof", "a late response", "02 03 02 00 00")
        modes = {line.name: line.mode for line in lines(bench.gateway)}
        (packet,) = packets(late, modes)
        frame = bytes.fromhex("02 03 02 00 00")
        assert packet.data == (with_crc(frame) if kind == "line" else bytes.fromhex("0000 0000 0005") + frame)


async def test_it_has_the_same_series_of_metrics():
    found = []
    for kind in OWNERS:
        async with both(kind) as (bench, *_):
            client = bench.client()
            await client.asks(37, "03 00 00 00 01")
            await client.asks(38, "03 00 00 00 01")
            families = await read(bench.running)
            series = {(one.name, *labels) for one in families if "unit" in one.labels for labels, *_ in one.values}
            found.append(series)
    assert found[0] == found[1]
    assert ("unit_timeout_limit_seconds", "roof", "37") in found[1]


async def test_its_answer_times_are_measured(kind):
    async with both(kind) as (bench, *_):
        client = bench.client()
        for _ in range(4):
            await client.asks(37, "03 00 00 00 05")
        times = (await ask(bench.running, "times", unit="inverter"))["times"]
        (row,) = [each for each in times.rows if each.items == 5]
        assert (times.name, times.profile, row.function, row.count) == ("inverter", "inverter", 3, 4)
        assert row.times_ms == pytest.approx([10] * 4, abs=3)
        assert row.allowed_ms == 200
        assert row.limit_ms >= 200


async def test_a_limit_is_proposed_with_what_the_network_adds():
    async with both("upstream") as (bench, *_):
        client = bench.client()
        for _ in range(ENOUGH):
            await client.asks(37, "03 00 00 00 05")
        (times,) = answer_times(bench.gateway, pictured(bench.running, 37))
        assert times.proposed_ms == pytest.approx(100 + 1.5 * 10, abs=1)


async def test_how_busy_a_line_or_a_connection_is(kind):
    async with both(kind) as (bench, inverter, _):
        inverter.delay = 0.05
        client = bench.client()
        sampling = asyncio.create_task(bench.recent.keep_sampling(lambda: bench.gateway))
        for _ in range(300):
            await asyncio.gather(client.asks(37, "03 00 00 00 01"), asyncio.sleep(0.2))
        now = status(bench.running)
        sampling.cancel()
        (owner,) = (*now.lines, *now.upstreams)
        # A line has also the silence after the response. Of a connection one of 16 places is taken.
        share = 0.25 if kind == "line" else 0.25 / 16
        assert owner.busy_share == pytest.approx(share, rel=0.1)
        assert owner.requests_per_s == pytest.approx(5, rel=0.05)


@pytest.mark.parametrize("verb", ["bench", "scan"])
async def test_what_is_for_lines_only_says_so(verb):
    async with both("upstream") as (bench, *_):
        with pytest.raises(WrongQuestion, match="roof is a connection to another server: that is for lines only"):
            await ask(bench.running, verb, line="roof")


async def test_a_limit_that_is_tight_is_told(kind):
    async with both(kind) as (bench, *_):
        device = bench.gateway.owners[0].devices[38]
        device.counts[3].ok += 1
        for _ in range(ENOUGH):
            device.counts.times[3].answered(0.27, 0.0, 0.3)
        (event,) = TightLimits().look(bench.gateway, STEP)
        assert (event.line, event.unit, event.device, event.limit_ms) == ("roof", 2, "meter", 300)


async def test_doctor_finds_the_same_and_names_the_same_keys():
    rows = []
    for kind in OWNERS:
        async with both(kind) as (bench, inverter, meter):
            client = bench.client()
            meter.delay = 0.5
            for _ in range(3):
                await client.asks(38, "03 00 00 00 01")
                await asyncio.sleep(2.0)
            inverter.silent = True
            for _ in range(4):
                await client.asks(37, "03 00 00 00 01")
                await asyncio.sleep(2.0)
            findings = (await ask(bench.running, "doctor", ask=False))["findings"]
            fixes = [each for each in findings if each.level == "fix"]
            rows.append([(each.about, each.what) for each in fixes])
            place = place_of(bench.gateway.owners[0].devices[38].source, "timeout")
            assert fixes[1].remedy == f'{place}: timeout = "750 ms"'
    assert [about for about, _ in rows[1]] == ["unit 37, inverter", "unit 38, meter"]
    assert [about for about, _ in rows[0]] == [about for about, _ in rows[1]]


async def test_it_is_mirrored_and_published_and_takes_writes_from_the_broker(kind):
    async with both(kind, CONFIG + MIRROR + MQTT) as (bench, inverter, _):
        inverter.holding[0], inverter.holding[8] = 5, 1
        await asyncio.sleep(5.0)  # polls that came before it was there have made it rest
        broker, topic = FakeBroker.of(bench), "modbus/plant/inverter"
        await asyncio.sleep(2.0)
        assert await bench.client().asks(241, "03 00 00 00 01") == "03 02 00 05"
        assert broker.connect() == ["modbus/plant/+/+/set"]
        assert broker.retained[f"{topic}/availability"] == b"online"
        first = json.loads(broker.retained[topic])
        assert (first["power"], first["state"], first["limit"]) == (5, "on", 0)
        broker.send(f"{topic}/limit/set", "9")
        await asyncio.sleep(0.5)
        said = broker.said()
        assert said[f"{topic}/limit/result"] == {"value": "9", "result": "ok"}
        assert inverter.holding[20] == 9
        inverter.script.extend([[Answer(9.0, b"")]] * 100)
        await asyncio.sleep(10.0)
        assert broker.said()[f"{topic}/availability"] == "offline"


async def test_home_assistant_is_told_of_it_and_through_what_it_is_reached():
    told = []
    for kind in OWNERS:
        async with both(kind, CONFIG + MQTT) as (bench, *_):
            (message,) = Discovery(Topics("plant"), "homeassistant").messages(bench.gateway.plan.mqtt.devices, {})
            told.append(json.loads(message.payload))
    assert told[0] == told[1]
    assert "An inverter" in json.dumps(told[1])


async def test_it_is_born_in_sparkplug(kind):
    config = CONFIG + MQTT.replace("write ", 'sparkplug = { group = "g" }\nwrite ')
    async with both(kind, config) as (bench, *_):
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        assert "spBv1.0/g/DBIRTH/plant/inverter" in [message.topic for message in broker.messages]
