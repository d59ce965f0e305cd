"""What the gateway tells of a virtual unit: its status, metrics and values, and why reads of it failed."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest

from gateway.cli.show.trace_rows import rows
from gateway.cli.units.unit import DaemonUnit
from gateway.errors import ExceptionReceived
from gateway.observe.families import Family
from gateway.operator.operations.answers.unit import RequestAnswer
from gateway.operator.operations.asked import ToExplain, Traced
from gateway.operator.operator import Operator
from gateway.operator.status.metrics import read
from gateway.operator.trace.stories import sentences, told
from gateway.operator.trace.trace import page
from gateway.operator.trace.why import stories
from gateway.operator.units.units import units_of
from gateway.operator.values.steps import Step
from kit.asking import NO_FILE, ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.mapped_hall import CONFIG, attach
from kit.statuses import status

POWERS = "03 00 00 00 03"
ALL_ROWS = ("03 00 00 00 04", "03 00 14 00 04")


@pytest.fixture
async def bench() -> AsyncIterator[GatewayBench]:
    async with gateway_bench(CONFIG) as bench:
        yield bench


@pytest.fixture
async def meters(bench: GatewayBench) -> dict[str, SimulatedDevice]:
    """The meters, all of which have answered."""
    meters = attach(bench)
    await asyncio.sleep(10)
    return meters


def virtual(bench: GatewayBench) -> Any:
    (found,) = status(bench.running).virtual
    return found


def facts(bench: GatewayBench, **asked: Any) -> list[Any]:
    now = asyncio.get_running_loop().time()
    return list(page(bench.running, Traced(since=60, **asked), (now, now)).facts)


def last_story(bench: GatewayBench, who: str) -> Any:
    now = asyncio.get_running_loop().time()
    return stories(bench.running, ToExplain(who, 1), (now, now)).stories[0]


async def test_the_status_has_each_source_with_its_fresh_rows_and_its_oldest_value(bench, meters) -> None:
    await bench.client().asks(240, POWERS)
    await bench.client().asks(240, "03 00 0A 00 01")
    meters["meter-2"].silent = True
    await asyncio.sleep(6)
    found = virtual(bench)
    assert (found.unit, found.name, found.requests, found.exceptions) == (240, "block", 2, 1)
    assert [(each.device, each.rows, each.fresh) for each in found.sources] == [
        ("meter-1", 2, 2),
        ("meter-3", 1, 1),
        ("meter-2", 1, 0),
    ]
    assert found.fresh_sources == 2
    assert [each.state(3000) for each in found.sources] == ["fresh", "fresh", "stale"]
    oldest = found.sources[2].age_ms
    assert 6000 <= oldest <= 7500
    assert found.age_ms == oldest
    assert found.failed_polls > 0


async def test_a_source_that_has_never_answered_has_no_age(bench) -> None:
    attach(bench)["meter-3"].silent = True
    await asyncio.sleep(10)
    found = virtual(bench)
    assert [(each.device, each.age_ms is None, each.state(3000)) for each in found.sources if not each.is_fresh] == [
        ("meter-3", True, "unknown")
    ]
    assert found.age_ms is None


async def test_a_source_without_a_valid_value_is_not_fresh(bench, meters) -> None:
    meters["meter-3"].holding[0] = 0x8000
    await asyncio.sleep(2)
    assert [(each.device, each.state(3000)) for each in virtual(bench).sources if not each.is_fresh] == [
        ("meter-3", "invalid")
    ]


async def test_metrics_have_the_oldest_age_and_count_the_sources_by_state(bench, meters) -> None:
    async def values(name: str) -> dict[tuple[str, ...], Any]:
        families: dict[str, Family] = {family.name: family for family in await read(bench.running)}
        return dict(families[name].values)

    assert (await values("image_age_seconds"))["240",] < 1.5
    assert await values("image_sources") == {("240", "fresh"): 3, ("240", "stale"): 0}
    meters["meter-2"].silent = True
    await asyncio.sleep(6)
    assert (await values("image_age_seconds"))["240",] > 6
    assert await values("image_sources") == {("240", "fresh"): 2, ("240", "stale"): 1}
    await bench.client().asks(240, "06 00 14 00 07")
    await asyncio.sleep(1)
    assert await values("image_age_seconds") == {}


async def test_it_is_found_by_its_name_and_tells_how_it_is_doing(bench, meters) -> None:
    head = next(each for each in units_of(Operator(bench.running, NO_FILE)) if each.name == "block")
    assert (head.unit, head.kind, head.longest_wait_ms > 0) == (240, "virtual", True)
    found = await ask(bench.running, "unit-status", unit="block")
    assert found["unit"].status.fresh_sources == 3
    assert await ask(bench.running, "unit-status", unit=240) == found


async def test_its_points_are_read_by_their_names(bench, meters) -> None:
    meters["meter-1"].holding[0], meters["meter-3"].holding[0], meters["meter-1"].holding[8] = 125, 30, 1
    await asyncio.sleep(1.5)
    values = {each.point: each.value for each in (await ask(bench.running, "points", unit="block"))["values"]}
    assert values["meter-1.power"] == 12.5
    assert values["meter-3.power"] == 3.0
    assert values["meter-1.mode"] == "run"
    one = await ask(bench.running, "point", unit="block", name="meter-1.power")
    assert (one["values"][0].value, one["values"][0].unit) == (12.5, "kW")


async def test_a_stale_source_does_not_keep_other_points_from_being_read(bench, meters) -> None:
    meters["meter-1"].holding[0], meters["meter-3"].silent = 125, True
    await asyncio.sleep(10)
    answer = await ask(bench.running, "points", unit="block")
    values = {each.point: each.value for each in answer["values"]}
    assert (values["meter-1.power"], values["meter-3.fresh"]) == (12.5, 0)
    assert "meter-3.power" not in values
    (failure,) = answer["errors"]
    assert (failure.address, failure.count, failure.exception) == (1, 2, 11)
    assert "block: meter-3 (holding 0) has not answered for too long" in failure.reason


async def test_a_command_names_the_source_of_an_exception(bench, meters) -> None:
    meters["meter-3"].silent = True
    await asyncio.sleep(10)
    with pytest.raises(ExceptionReceived, match="meter-3"):
        await ask(bench.running, "read", unit="block", area="holding", start=0, end=2)

    class Daemon:
        gateway = None

        def __init__(self) -> None:
            self.answers = [unit, answer]

        def ask(self, *_: object) -> Any:
            return self.answers.pop(0)

        def wait_for(self, seconds: float) -> None:
            pass

    unit = next(each for each in units_of(Operator(bench.running, NO_FILE)) if each.name == "block")
    answer = RequestAnswer(**await ask(bench.running, "request", unit="block", pdu=POWERS))
    reason = DaemonUnit(Daemon(), "block").ask(Step(bytes.fromhex(POWERS))).reason  # type: ignore[arg-type]
    assert reason == "block: meter-3 (holding 0) has not answered for too long"


async def test_the_trace_of_a_read_names_the_sources_of_its_values(bench, meters) -> None:
    client = bench.client()
    await client.asks(240, POWERS)
    await client.asks(240, "03 00 5A 00 02")
    await client.asks(240, "03 00 C8 00 01")
    first, states, own = [fact for fact in facts(bench, unit="block") if fact["kind"] == "answered"]
    assert first["sources"] == ("meter-1", "meter-3")
    assert states["sources"] == ("meter-1", "meter-2", "meter-3")
    assert "sources" not in own
    assert [row.text for row in rows(first)][1] == "0 0 0  [from meter-1, meter-3]"


@pytest.mark.parametrize(
    ("count", "text"),
    [(1, "from m1"), (3, "from m1, m2, m3"), (4, "from m1, m2, ... 4 sources"), (20, "from m1, m2, ... 20 sources")],
)
def test_of_many_sources_a_row_names_some(count, text) -> None:
    where = {"kind": "answered", "time": 1.0, "received": 1.0, "line": "", "name": "block", "unit": 240, "client": "c"}
    said = {"request": "03 00 00 00 01", "response": "03 02 00 05", "reason": ""}
    sources = [f"m{each}" for each in range(1, count + 1)]
    assert [row.text for row in rows({**where, **said, "sources": sources})][1] == f"5  [{text}]"


async def test_the_trace_of_a_write_says_to_which_device_and_register_it_went(bench, meters) -> None:
    assert await bench.client().asks(240, "06 00 15 00 07") == "06 00 15 00 07"
    assert meters["meter-2"].holding[101] == 7
    written = [fact for fact in facts(bench, unit="block") if fact["kind"] == "exchange"]
    assert [(fact["name"], fact["device"], fact["line"], fact["address"]) for fact in written] == [
        ("block", "meter-2", "hall", 2)
    ]
    assert "write holding 101 (40102): 7  [10.0.0.9:49152 as 240 to meter-2" in next(rows(written[0])).text
    assert written[0] in facts(bench, unit="meter-2")


async def test_why_a_read_failed_names_the_source_and_what_to_do(bench, meters) -> None:
    meters["meter-3"].silent = True
    await asyncio.sleep(10)
    assert await bench.client().asks(240, POWERS) == "83 0B"
    story = last_story(bench, "block")
    assert (story["stale"], story["stale_on"]) == ("meter-3", "yard")
    said = sentences(story)
    assert said.startswith("No fresh value: block: meter-3 (holding 0) has not answered for too long.")
    assert "It asks for values of 2 sources: meter-1, meter-3." in said
    assert "modbus-gateway trace --why meter-3 tells what became of its polls, modbus-gateway doctor yard" in said


async def test_a_mirror_says_what_to_do_likewise() -> None:
    mirror = '[[image]]\nunit = 241\nname = "copy"\nof = "meter-3"\nread = [{ holding = "0-0", every = "1 s" }]\n'
    async with gateway_bench(CONFIG + mirror) as bench:
        attach(bench)["meter-3"].silent = True
        await asyncio.sleep(10)
        assert await bench.client().asks(241, "03 00 00 00 01") == "83 0B"
        said = sentences(last_story(bench, "copy"))
        assert said.startswith(
            "No fresh value: meter-3 (holding 0) has not answered for too long. modbus-gateway trace --why meter-3"
        )


async def test_why_a_write_failed_names_the_device(bench, meters) -> None:
    meters["meter-2"].silent = True
    assert await bench.client().asks(240, "06 00 15 00 07") == "86 0B"
    heading, *_ = told(last_story(bench, "block")).splitlines()
    assert heading.endswith("10.0.0.9:49152 asked unit 240 (block: meter-2): write holding 101 (40102): 7")


async def test_a_joined_poll_is_found_by_each_of_those_that_want_it() -> None:
    mirror = '[[image]]\nunit = 241\nname = "copy"\nof = "meter-3"\nread = [{ holding = "0-0", every = "1 s" }]\n'
    async with gateway_bench(CONFIG + mirror) as bench:
        attach(bench)["meter-3"].silent = True
        await asyncio.sleep(5)
        label = facts(bench, unit="meter-3")[0]["client"]
        wanting = label.split(", ")
        assert sorted(wanting) == sorted({each.unit.label for each in bench.gateway.polling_units})
        for who in (label, *wanting):
            assert {fact["client"] for fact in facts(bench, client=who) if fact["line"] == "yard"} == {label}
            assert last_story(bench, who)["name"] == "meter-3"


async def test_others_get_their_turns_while_very_many_points_are_read() -> None:
    points = ", ".join(f'{{ name = "p{each}", holding = {each} }}' for each in range(100))
    rows = ",\n".join(f'{{ at = {100 * each}, device = "m{each}", point = "*", every = "10 s" }}' for each in range(20))
    devices = ", ".join(f'{{ unit = {each + 1}, name = "m{each}", profile = "meter" }}' for each in range(20))
    config = f"""
[profile.meter]
points = [{points}]
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{devices}]
[[image]]
unit = 240
name = "block"
stale = "30 s"
map = [
{rows}
]
"""
    async with gateway_bench(config) as bench:
        bench.attach("hall", SimulatedLine("rtu", *(SimulatedDevice(each) for each in range(1, 21))))
        await asyncio.sleep(20)
        turns = 0

        async def others() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(others())
        answer = await ask(bench.running, "points", unit="block")
        task.cancel()
        assert len(answer["values"]) == 2000
        assert turns > 10  # 16 requests
