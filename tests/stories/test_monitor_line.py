"""What an operator sees of a line where the gateway only listens; and that nothing is ever sent there."""

import asyncio
from contextlib import asynccontextmanager

import pytest

from gateway.errors import WrongQuestion
from kit.asking import answers, ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.others import Others

CONFIG = """
[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [{ unit = 1, name = "silo" }]

[[line]]
name    = "old-plc"
port    = "/dev/plc"
baud    = 9600
role    = "monitor"
devices = [{ unit = 3, as = 63, name = "boiler" }, { unit = 4, as = 64, name = "pump" }]

[[image]]
unit = 241
name = "copy"
of   = "boiler"
read = [{ holding = "0-9" }]
"""
READ = "03 0000 0002"


@asynccontextmanager
async def stage():
    """The gateway beside a client that asks units 3, 4 and 9 of an old plant; 9 is off."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, delay=0.01)))
        others = Others(bench.lines["plc"], SimulatedDevice(3, delay=0.02), SimulatedDevice(4, delay=0.02))
        await asyncio.sleep(6.0)
        yield bench, others
        assert bench.lines["plc"].written == b""


async def status_of(bench):
    return (await ask(bench.running, "status"))["status"]


async def told(bench):
    (line,) = (await status_of(bench)).monitors
    return line


async def units(bench):
    return [unit for unit in (await status_of(bench)).units if unit.line == "old-plc"]


async def doctor(bench, **request):
    answer = await ask(bench.running, "doctor", **request)
    return [(each.level, each.about, each.what) for each in answer["findings"] if each.about != "hall"]


async def test_status_counts_what_is_heard_and_who_uses_the_line():
    async with stage() as (bench, others):
        for _ in range(10):
            await others.ask(3, READ)
        await others.ask(9, READ)
        await asyncio.sleep(6.0)
        line = await told(bench)
        counts = line.counts
        assert (line.name, line.state, line.baud) == ("old-plc", "up", 9600)
        assert (counts.requests, counts.answers, counts.sure, counts.unanswered) == (11, 10, 10, 1)
        assert [(each.on_the_wire, each.requests) for each in line.unknown_units] == [(9, 1)]
        assert line.users[0].device == "boiler"
        assert 0.0 < line.busy_share < 1.0
        assert line.heard_ms > 5000


async def test_units_are_fine_or_were_not_asked_and_have_the_times_of_their_answers():
    async with stage() as (bench, others):
        await others.ask(3, READ)
        boiler, pump = await units(bench)
        assert (boiler.state, boiler.counts.ok, boiler.counts.sent) == ("fine", 1, 1)
        assert boiler.times.answer_p50_ms is not None
        assert boiler.last_answer_ms is not None
        assert pump.counts.sent == 0


async def test_a_broadcast_is_no_time_out_of_anybody():
    async with stage() as (bench, others):
        await others.ask(0, "06 0000 0001")
        boiler, pump = await units(bench)
        for unit in (boiler, pump):
            assert (unit.counts.broadcast, unit.counts.timeout) == (1, 0)


@pytest.mark.parametrize(
    "request_",
    [
        {"verb": "scan", "line": "old-plc", "units": ["3"]},
        {"verb": "bench", "line": "old-plc"},
    ],
)
async def test_commands_that_send_are_refused(request_):
    async with stage() as (bench, _):
        with pytest.raises(WrongQuestion, match="on old-plc the gateway only listens"):
            await answers(bench.running, request_)


async def test_a_request_to_its_unit_gets_0a_and_says_why():
    async with stage() as (bench, _):
        assert await bench.client().asks(63, READ) == "83 0A"
        answer = await ask(bench.running, "request", unit="boiler", pdu="03 00 00 00 01")
        assert (answer["pdu"], answer["result"]) == ("83 0A", "only_heard")
        assert answer["reason"] == "the gateway only listens on old-plc"


async def test_calibrate_has_the_times_that_were_heard():
    async with stage() as (bench, others):
        for _ in range(5):
            await others.ask(3, READ)
        measured = (await ask(bench.running, "times", unit="boiler"))["times"]
        assert (measured.mode, measured.baud) == ("rtu", 9600)
        (row,) = measured.rows
        assert (row.function, row.items, row.count) == (3, 2, 5)


async def test_the_trace_has_what_others_ask():
    async with stage() as (bench, others):
        await others.ask(3, READ)
        answer = await ask(bench.running, "trace", line="old-plc", since=2.0)
        (exchange,) = [each for each in answer["facts"] if each["kind"] == "exchange"]
        assert (exchange["unit"], exchange["name"], exchange["client"]) == (63, "boiler", "another client")


async def test_doctor_waits_and_says_that_nothing_is_heard():
    async with stage() as (bench, _):
        now = asyncio.get_running_loop().time()
        assert ("fix", "old-plc", "nothing has been heard yet") in await doctor(bench, line="old-plc")
        assert asyncio.get_running_loop().time() - now >= 3.0


async def test_doctor_says_what_is_heard_and_asks_nothing():
    async with stage() as (bench, others):
        for _ in range(5):
            await others.ask(3, READ)
            await others.ask(9, READ)
        rows = await doctor(bench, line="old-plc")
        assert ("ok", "old-plc", "10 requests heard, 5 with an answer, values of 5 taken") in rows
        assert ("note", "old-plc", "nobody has asked pump (unit 4) yet") in rows
        assert ("note", "old-plc", "units are asked that are not configured: 9 (5 requests)") in rows


async def test_doctor_finds_a_wrong_rate():
    async with stage() as (bench, _):
        for _ in range(40):
            bench.lines["plc"].deliver(bytes.fromhex("F8 80 78 1F 80"))
            await asyncio.sleep(0.3)
        assert ("fix", "old-plc", "what is heard is no Modbus at 9600 8E1, RTU") in await doctor(bench)


async def test_a_line_that_is_lost_is_down_and_comes_back():
    async with stage() as (bench, others):
        bench.lines["plc"].pull()
        await asyncio.sleep(0.5)
        assert (await told(bench)).state == "down"
        assert [event.line for event in bench.events if event.name == "line_lost"] == ["old-plc"]
        bench.lines["plc"].plug()
        await asyncio.sleep(8.0)
        await others.ask(3, READ)
        assert (await told(bench)).state == "up"
        assert (await told(bench)).counts.requests == 1
