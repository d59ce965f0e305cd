"""What a line can carry, by arithmetic, and what it carries at its real pace: in virtual time."""

import asyncio
import re

import pytest

from gateway.cli.verbs.bench import show_bench
from gateway.config.plan.line_load import load_of, read_rates, total_share
from gateway.errors import WrongQuestion
from gateway.operator.operations.asked import ToMeasure
from gateway.simulator.generic import Generic
from gateway.simulator.mint import Mint
from gateway.tools.bench import bench
from kit.asking import answering, answers
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.paced import attach_paced
from kit.statuses import status

#: How far a measured minute may be from the forecast.
CLOSE = 0.03

MINTS = """
[[line]]
name    = "hall"
port    = "/dev/hall"
mode    = "ascii"
baud    = {baud}
wire    = "serial"
devices = [{{ unit = 1, name = "axis-1", profile = "mint" }}, {{ unit = 2, name = "axis-2", profile = "mint" }}]
"""
#: A simulated device begins to answer 5 ms after the silence that ends its request.
METERS = """
[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = {baud}
wire    = "serial"
devices = [{{ unit = "1-3", name = "meter-*", profile = "meter" }}]

[profile.meter]
holding = "0-99"
timing  = [{{ fc = 3, items = 1, time = "{time}" }}, {{ fc = 3, items = 125, time = "{time}" }}]
"""
#: 5 ms and t3.5 at each rate.
ANSWERS_IN = {9600: "9.0104 ms", 19200: "7.0052 ms", 115200: "6.75 ms"}
MIRROR = """
[[image]]
unit = 241
of   = "meter-1"
read = [{ holding = "0-9", every = "100 ms" }, { holding = "20", every = "1 s" }]
stale = "1 s"
"""


def mints(running: GatewayBench, baud: int) -> None:
    attach_paced(running.lines["hall"], "ascii", baud, Mint(1), Mint(2))


def meters(running: GatewayBench, baud: int) -> None:
    attach_paced(running.lines["hall"], "rtu", baud, *(Generic(unit) for unit in (1, 2, 3)))


def config_of_meters(baud: int) -> str:
    return METERS.format(baud=baud, time=ANSWERS_IN[baud])


async def measured(running: GatewayBench, **question):
    return await bench(running.running, ToMeasure("hall", **question), lambda: True)


@pytest.mark.search
@pytest.mark.parametrize("items", [1, 10, 99])
@pytest.mark.parametrize("baud", [9600, 19200, 115200])
async def test_an_ascii_line_carries_as_many_reads_in_a_minute_as_foretold(baud, items):
    async with gateway_bench(MINTS.format(baud=baud)) as running:
        mints(running, baud)
        result = await measured(running, items=items)
    assert (result.exceptions, result.failed, result.others) == (0, 0, 0)
    assert result.measured_per_second == pytest.approx(result.expected_per_second, rel=CLOSE)
    assert result.busy_share > 0.97


@pytest.mark.search
@pytest.mark.parametrize("items", [1, 10, 100])
@pytest.mark.parametrize("baud", [9600, 19200, 115200])
async def test_an_rtu_line_carries_as_many_reads_in_a_minute_as_foretold(baud, items):
    async with gateway_bench(config_of_meters(baud)) as running:
        meters(running, baud)
        result = await measured(running, items=items)
    assert (result.exceptions, result.failed, len(result.reads)) == (0, 0, 3)
    assert result.measured_per_second == pytest.approx(result.expected_per_second, rel=CLOSE)


async def test_the_rates_that_check_shows_are_those_of_bench():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        line = running.gateway.plan.lines[0]
        rate = next(one for one in read_rates(line, line.devices[0]) if one.items == 10)
        alone = await measured(running, unit="meter-1")
        in_turn = await measured(running)
    assert alone.measured_per_second == pytest.approx(rate.alone, rel=CLOSE)
    assert in_turn.measured_per_second / 3 == pytest.approx(rate.in_turn, rel=CLOSE)


async def test_a_line_without_a_wire_is_measured_only():
    async with gateway_bench(
        MINTS.format(baud=9600).replace('"serial"', '"direct"').replace('"mint"', '"generic"')
    ) as it:
        mints(it, 9600)
        result = await measured(it, seconds=1)
    assert result.expected_per_second is None
    assert result.measured_per_second > 10
    shown = show_bench(result)
    assert re.search(r"by arithmetic +- +-", shown)
    assert "of the arithmetic" not in shown


async def test_a_line_is_busy_with_its_polls_as_foretold():
    async with gateway_bench(config_of_meters(9600) + MIRROR) as running:
        meters(running, 9600)
        plan, loop = running.gateway.plan, asyncio.get_running_loop()
        for mirror in running.gateway.mirrors:
            mirror.start()
        await asyncio.sleep(5.0)
        spent, began = running.gateway.lines[0].driver.line.spent, loop.time()
        before = spent.phases().busy
        await asyncio.sleep(60.0)
        share = (spent.phases().busy - before) / (loop.time() - began)
    assert share == pytest.approx(total_share(load_of(plan.lines[0], plan)), rel=CLOSE)


async def test_other_clients_of_the_line_are_told():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        client = running.client()

        async def ask() -> None:
            for _ in range(20):
                await client.asks(2, "03 00 00 00 01")
                await asyncio.sleep(0.1)

        asking = asyncio.create_task(ask(), name="client")
        result = await measured(running, seconds=5)
        await asking
    assert result.others == 20
    assert result.failed == 0


async def test_who_takes_the_line_up_is_shown():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        await measured(running, seconds=10, unit=2)
        await running.client(host="10.0.0.9").asks(3, "03 00 00 00 01")
        line = status(running.running).lines[0]
    first, second = line.users
    assert (first.client, first.on_the_wire, first.device, first.function) == ("control", 2, "meter-2", 3)
    assert (second.client, second.on_the_wire, second.function) == ("10.0.0.9", 3, 3)
    assert first.share == pytest.approx(line.busy_share, rel=0.05)


async def test_who_took_the_line_up_is_known_for_a_minute():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        line = running.gateway.lines[0]
        sampling = asyncio.create_task(running.recent.keep_sampling(lambda: running.gateway), name="samples")
        await asyncio.sleep(120.0)
        result = await measured(running, seconds=30, unit=1)
        now = asyncio.get_running_loop().time
        (user,) = running.recent.users(line, now())
        assert user.per_second * 60 == pytest.approx(result.answered, rel=0.1)
        assert user.share == pytest.approx(0.5, rel=0.1)
        await asyncio.sleep(90.0)
        assert running.recent.users(line, now()) == []
        sampling.cancel()


async def test_a_measurement_ends_when_whoever_asks_has_left():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        loop = asyncio.get_running_loop()
        began = loop.time()
        await bench(running.running, ToMeasure("hall"), lambda: loop.time() < began + 2)
        assert loop.time() < began + 3


async def test_a_line_that_is_down_is_not_asked_all_the_time():
    async with gateway_bench(config_of_meters(19200)) as running:
        running.lines["hall"].pull()
        result = await measured(running, seconds=5)
    assert result.failed <= 102
    assert (result.answered, result.last_failure) == (0, "line_down")


@pytest.mark.parametrize(
    ("question", "said"),
    [
        ({"line": "hal"}, 'there is no line "hal"; did you mean "hall"?'),
        ({"line": "hall", "unit": 9}, "unit 9 is not on hall"),
        ({"line": "hall", "seconds": 0}, '"seconds" must be a number above 0, 3600 at most'),
        ({"line": "hall", "address": 65536}, '"address" must be a number from 0 to 65535'),
    ],
)
async def test_what_cannot_be_measured_is_said(question, said):
    async with gateway_bench(config_of_meters(19200)) as running:
        with pytest.raises(WrongQuestion) as wrong:
            await answers(running.running, {"verb": "bench", **question})
    assert str(wrong.value) == said


async def test_a_measurement_puts_no_unit_to_rest():
    async with gateway_bench(config_of_meters(19200)) as running:
        attach_paced(running.lines["hall"], "rtu", 19200, Generic(1), Generic(3))
        result = await measured(running, seconds=5)
        assert result.answered > 100
        assert not any(device.breaker.rest for device in running.gateway.lines[0].devices.values())
        began = asyncio.get_running_loop().time()
        result = await measured(running, seconds=60, unit=2)
        assert (result.failed, result.left_out) == (1, ["meter-2"])  # its third failure in a row
        assert asyncio.get_running_loop().time() < began + 10


async def test_a_measurement_ends_when_a_reload_changes_its_line():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        measuring = asyncio.create_task(measured(running, seconds=60))
        await asyncio.sleep(1.0)
        running.drop_lines()
        with pytest.raises(WrongQuestion, match="a reload has changed hall: measure it again"):
            async with asyncio.timeout(1.0):
                await measuring


async def fail(client) -> None:
    """Ask a unit that is not there until it rests."""
    for pause in (3.0, 3.0, 0.0):
        await client.asks(2, "03 00 00 00 01")
        await asyncio.sleep(pause)


async def test_units_that_rest_are_left_out_and_named():
    async with gateway_bench(config_of_meters(19200)) as running:
        attach_paced(running.lines["hall"], "rtu", 19200, Generic(1), Generic(3))
        client = running.client()
        await fail(client)
        with pytest.raises(WrongQuestion, match="meter-2 backs off after several failures, and nothing is sent to it"):
            await measured(running, seconds=5, unit=2)
        assert running.gateway.lines[0].devices[2].breaker.is_resting(asyncio.get_running_loop().time())
        result = await measured(running, seconds=5)
        assert [read.unit for read in result.reads] == [1, 3]
        assert (result.failed, result.left_out) == (0, ["meter-2"])
        assert result.measured_per_second == pytest.approx(result.expected_per_second, rel=CLOSE)
        assert "left out, because they rest after several failures: meter-2" in show_bench(result)


async def test_a_unit_that_comes_to_rest_meanwhile_is_no_failure_of_the_line():
    async with gateway_bench(config_of_meters(19200)) as running:
        attach_paced(running.lines["hall"], "rtu", 19200, Generic(1), Generic(3))
        failing = asyncio.create_task(fail(running.client()), name="client")
        result = await measured(running, seconds=20)
        await failing
        assert result.failed <= 2
        assert result.answered > 100


async def test_how_far_a_measurement_is_comes_each_second_if_it_is_asked_for():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        question = {"line": "hall", "seconds": 5}
        steps = await answers(running.running, {"verb": "bench", **question, "progress": True})
        *told, last = steps
        assert [each["progress"].elapsed_s for each in told] == [1.0, 2.0, 3.0, 4.0, 5.0][: len(told)]
        assert 4 <= len(told) <= 5
        assert 0 < told[0]["progress"].reads < told[-1]["progress"].reads <= last["bench"].answered
        assert len(await answers(running.running, {"verb": "bench", **question})) == 1


async def test_a_measurement_whose_answers_nobody_takes_any_more_ends():
    async with gateway_bench(config_of_meters(19200)) as running:
        meters(running, 19200)
        steps = answering(running.running, {"verb": "bench", "line": "hall", "progress": True})
        assert "progress" in await anext(steps)
        await steps.aclose()
        assert not [task for task in asyncio.all_tasks() if task.get_name().startswith("bench")]
