"""A scan in a whole gateway: who is found, who is not asked, and what its clients notice. In virtual time, at pace."""

import asyncio
from contextlib import aclosing

import pytest

from gateway.errors import WrongQuestion
from gateway.modbus.rtu import encode
from gateway.operator.operations.answers.scan import Found, Progress
from gateway.simulator.faults import Faults
from gateway.simulator.generic import Generic
from gateway.simulator.mint import Mint
from gateway.simulator.v80 import V80
from gateway.simulator.weigher import Weigher
from kit.asking import answering
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
baud = 19200
devices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }, { unit = 6, profile = "v80" }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [41]
"""
PASSING = '[[line]]\nname = "hall"\nport = "/dev/hall"\nbaud = 19200\n'
LONE = '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 0, as = 50, profile = "weigher" }]\n'
ASCII = '[[line]]\nname = "hall"\nport = "/dev/hall"\nmode = "ascii"\ndevices = [{ unit = 1 }]\n'


async def scanned(bench, **request) -> dict[int, Found]:
    """What a scan finds."""
    *_, last = [step async for step in answering(bench.running, {"verb": "scan", "line": "hall", **request})]
    return {each.unit: each for each in last["found"]}


async def told(bench, **request):
    async with aclosing(answering(bench.running, {"verb": "scan", "line": "hall", **request})) as steps:
        return [step async for step in steps]


async def test_each_kind_is_found_with_its_profile_and_the_configured_are_not_asked():
    async with gateway_bench(CONFIG) as bench:
        devices = [Weigher(1), V80(6), Weigher(3, weight=12.5), V80(17), Generic(30), Generic(247)]
        bench.attach_at_pace("hall", *devices)
        found = await scanned(bench)
        assert {unit: (each.result, each.profile) for unit, each in found.items()} == {
            3: ("answers", "weigher"),
            17: ("answers", "v80"),
            30: ("answers", "generic"),
            247: ("answers", "generic"),
        }
        assert 9 < found[3].answer_ms < 15
        assert {1, 6}.isdisjoint(bench.lines["hall"].written[:1])


async def test_an_answer_without_a_wire_takes_no_time():
    """It may come before a wire could have carried the request."""
    async with gateway_bench(CONFIG.replace("baud = 19200", 'wire = "direct"')) as bench:
        bench.attach("hall", SimulatedLine("rtu", SimulatedDevice(3, delay=0.001)))
        assert (await scanned(bench, units="3"))[3].answer_ms == 0


async def test_who_is_configured_and_whether_one_of_them_answers_is_told():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Weigher(1), V80(6))
        *_, last = await told(bench, units="5-8")
        assert (last["asked"], last["known"], last["is_answered"]) == (3, "6", False)
        assert await bench.client().asks(41, "03 00 20 00 02")
        *_, last = await told(bench, units="7-8")
        assert (last["asked"], last["known"], last["is_answered"]) == (2, "", True)


async def test_a_mint_is_found_by_its_exception():
    async with gateway_bench(ASCII) as bench:
        bench.attach_at_pace("hall", Mint(4), V80(5), Generic(6), mode="ascii")
        found = await scanned(bench, units="1-9")
        assert [(each.unit, each.result, each.code, each.profile) for each in found.values()] == [
            (4, "exception", 2, "mint"),
            (5, "answers", None, "v80"),
            (6, "answers", None, "generic"),
        ]


@pytest.mark.parametrize("slower", [0.0, 0.002, 0.1])
async def test_two_devices_on_one_address_are_garbled_however_far_apart_they_answer(slower):
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Generic(9), Generic(9, faults=Faults(slow=slower)), Generic(10))
        found = await scanned(bench, units="8-11")
        assert {unit: each.result for unit, each in found.items()} == {9: "garbled", 10: "answers"}


async def test_a_burst_of_noise_is_no_device():
    async with gateway_bench(CONFIG) as bench:
        line = bench.lines["hall"]
        asked = []

        def written(data: bytes) -> None:
            asked.append(data[0])
            if data[0] == 9 and asked.count(9) == 1:
                line.deliver(b"\x55\xaa\x07")

        line.on_write = written
        assert await scanned(bench, units="8-10") == {}
        assert asked == [8, 9, 10, 9, 9]


@pytest.mark.parametrize("delay", [0.01, 0.6])
async def test_who_was_not_understood_once_is_asked_again(delay):
    async with gateway_bench(CONFIG) as bench:
        device = SimulatedDevice(9)
        answer = encode(9, bytes.fromhex("03 02 00 00"))
        device.script.extend([[(0.01, b"\x55\xaa\x07")], [(delay, answer)], [(delay, answer)]])
        bench.attach("hall", SimulatedLine("rtu", device))
        found = await scanned(bench, units="9")
        assert found[9].result == "answers"


async def test_who_answers_late_is_found_too():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Generic(9, faults=Faults(slow=0.6)))
        found = await scanned(bench, units="8-11")
        assert found[9].result == "answers"
        assert 600 < found[9].answer_ms < 620


async def test_silence_is_no_failure_of_anybody():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Weigher(1))
        before = len(bench.events)
        await scanned(bench, units="1-40")
        assert bench.events[before:] == []
        (hall,) = bench.gateway.lines
        assert sum(counts.sent for unit in hall.counts for counts in unit.values()) == 0


async def test_the_progress_is_told_with_the_time_that_is_left():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Weigher(1))
        begin = asyncio.get_running_loop().time()
        steps = await told(bench, units="1-40")
        took = asyncio.get_running_loop().time() - begin
        progress = [step["progress"] for step in steps[:-1]]
        assert all(isinstance(each, Progress) for each in progress)
        assert [each.asked for each in progress] == list(range(1, 39))
        assert progress[0].left_s == pytest.approx(took, rel=0.1)
        assert steps[-1]["asked"] == 38


async def test_clients_at_full_rate_wait_for_one_question_at_most():
    """Three clients ask again at once. Their slowest answer is one question of the scan later than without it."""
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", V80(6), Weigher(1), V80(20))
        clients = [bench.client(f"10.0.0.{number}:1") for number in range(3)]
        waits = []

        async def ask_on(client):
            while True:
                begin = client.now()
                assert not (await client.asks(6, "03 0000 000A")).startswith("83")
                waits.append(client.came_at - begin)

        asking = [asyncio.create_task(ask_on(client)) for client in clients]
        await asyncio.sleep(10)
        alone = max(waits)
        waits.clear()
        begin = asyncio.get_running_loop().time()
        found = await scanned(bench, units="10-40")
        took = asyncio.get_running_loop().time() - begin
        assert list(found) == [20]
        question = 0.3 + 15 * 11 / 19200 + 0.005 + 0.002  # limit and wire, latency, silence
        assert alone + 0.2 < max(waits) < alone + question
        assert len(waits) / took > 0.4 * 3 / alone
        for task in asking:
            task.cancel()


async def test_a_client_that_leaves_the_line_idle_for_a_moment_keeps_half_of_it():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", V80(6))
        client, answers = bench.client(), []

        async def ask_on():
            while True:
                answers.append(await client.asks(6, "03 0000 000A"))
                await asyncio.sleep(0.005)

        asking = asyncio.create_task(ask_on())
        await asyncio.sleep(10)
        alone = len(answers) / 10
        answers.clear()
        begin = client.now()
        await scanned(bench, units="10-40")
        assert len(answers) / (client.now() - begin) > 0.4 * alone
        asking.cancel()


async def test_where_units_pass_through_those_in_use_are_not_asked():
    async with gateway_bench(PASSING) as bench:
        bench.attach_at_pace("hall", Generic(2), Generic(3))
        assert await bench.client().asks(2, "03 0000 0001") == "03 02 00 00"
        assert list(await scanned(bench, units="1-5")) == [3]


async def test_who_stops_taking_progress_stops_the_scan():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Weigher(1))
        async with aclosing(answering(bench.running, {"verb": "scan", "line": "hall"})) as steps:
            await anext(steps)
        asked = len(bench.lines["hall"].written)
        await asyncio.sleep(5)
        assert len(bench.lines["hall"].written) <= asked + 8
        assert await scanned(bench, units="2-3") == {}


async def test_one_scan_of_a_line_at_a_time():
    async with (
        gateway_bench(CONFIG) as bench,
        aclosing(answering(bench.running, {"verb": "scan", "line": "hall"})) as steps,
    ):
        await anext(steps)
        with pytest.raises(WrongQuestion, match="a scan of hall goes on already"):
            await told(bench)


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ({"line": "hal"}, 'there is no line "hal"; did you mean "hall"'),
        ({"line": "panel"}, "on panel the gateway is a server"),
        ({"units": "1-900"}, "outside 1-255"),
        ({"units": "1"}, "1 of hall: configured or in use already"),
        ({"limit_s": 11}, "more than 0 and at most 10 s"),
        ({"limit_s": "1 s"}, "more than 0 and at most 10 s"),
    ],
)
async def test_what_cannot_be_scanned_is_refused_in_plain_words(request_, reason):
    async with gateway_bench(CONFIG) as bench:
        with pytest.raises(WrongQuestion, match=reason):
            await told(bench, **request_)


async def test_a_line_that_is_down_is_told():
    async with gateway_bench(CONFIG) as bench:
        bench.lines["hall"].pull("unplugged")
        await asyncio.sleep(1)
        with pytest.raises(WrongQuestion, match="hall is down: unplugged"):
            await told(bench)


@pytest.mark.parametrize(
    ("rows", "may_scan"),
    [
        ('[[access]]\nlisten = ["control"]\nallow = ["read"]\n', True),
        ('[[access]]\nlisten = ["control"]\nunits = [41]\nallow = ["read"]\n', False),
        ('[[access]]\nlisten = ["control"]\nallow = []\n', False),
    ],
)
async def test_it_needs_the_right_to_read_every_unit(rows, may_scan):
    async with gateway_bench(CONFIG + rows) as bench:
        if may_scan:
            assert await scanned(bench, units="7") == {}
        else:
            with pytest.raises(WrongQuestion, match="right to read every unit"):
                await told(bench, units="7")


async def test_address_0_is_asked_on_a_line_that_nobody_uses():
    async with gateway_bench(CONFIG) as bench:
        bench.attach_at_pace("hall", Weigher(5), V80(6))
        found = await scanned(bench, units=[0, "4-6"])
        assert [(each.unit, each.answers_from, each.profile) for each in found.values()] == [
            (0, 5, "weigher"),
            (5, None, "weigher"),
        ]
        assert await bench.client().asks(6, "03 0010 0001") == "03 02 00 00"
        with pytest.raises(WrongQuestion, match="hall is in use"):
            await told(bench, units=[0])


async def test_beside_a_device_that_is_asked_at_address_0_nobody_may_use_the_line():
    async with gateway_bench(LONE) as bench:
        bench.attach_at_pace("hall", Weigher(5))
        assert list(await scanned(bench, units="4-6")) == [5]
        assert await bench.client().asks(50, "03 0010 0001") == "03 02 00 05"
        with pytest.raises(WrongQuestion, match="hall is in use"):
            await told(bench, units="4-6")


async def test_at_all_speeds_the_line_is_lent_and_comes_back():
    async with gateway_bench(CONFIG) as bench:
        bench.running.ready.set()
        bench.attach_at_pace("hall", Weigher(1, baud=19200), Generic(9, baud=38400), Generic(7, baud=19200))
        reasons = set()
        steps = []
        async with aclosing(
            answering(bench.running, {"verb": "scan", "line": "hall", "units": "6-9", "all_speeds": True})
        ) as told_steps:
            async for step in told_steps:
                steps.append(step)
                reasons.add(str(bench.gateway.lines[0].reconnector.error))
                assert await bench.client().asks(41, "03 0010 0001") == "83 0A"
        assert reasons == {"its port is lent to a scan at all speeds"}
        assert [(each.unit, each.baud) for each in steps[-1]["found"]] == [(7, 19200), (9, 38400)]
        assert steps[3]["progress"].of == 3 * 9
        await asyncio.sleep(1)
        assert bench.opened["hall"].baud == 19200
        assert await bench.client().asks(41, "03 0010 0001") == "03 02 00 01"
        with pytest.raises(WrongQuestion, match="hall is in use: --all-speeds changes its rate"):
            await told(bench, all_speeds=True)


async def test_a_response_to_a_scan_that_was_left_is_given_to_no_client():
    async with gateway_bench(PASSING) as bench:
        device = SimulatedDevice(7, delay=0.6)
        device.holding[5] = 0x5555
        bench.attach("hall", SimulatedLine("rtu", device))
        async with aclosing(
            answering(bench.running, {"verb": "scan", "line": "hall", "units": "7", "all_speeds": True})
        ) as steps:
            await anext(steps)
        await asyncio.sleep(0.1)
        assert bench.lines["hall"].is_open
        assert await bench.client().asks(7, "03 0005 0001") in ("83 0B", "03 02 55 55")


@pytest.mark.parametrize("window", ["", 'late_window = "300 ms"\n'])
async def test_a_late_response_to_a_question_is_given_to_no_client(window):
    """A client may allow a unit more time than a scan does."""
    async with gateway_bench(PASSING + window) as bench:
        device = SimulatedDevice(7, delay=0.99)
        device.holding[5] = 0x5555
        bench.attach("hall", SimulatedLine("rtu", device))
        scanning = asyncio.create_task(told(bench, units="7", limit_s=0.1))
        await asyncio.sleep(0.95)
        assert await bench.client().asks(7, "03 0005 0001") in ("83 0B", "03 02 55 55")
        assert [each.result for each in (await scanning)[-1]["found"]] == ["answers"]
