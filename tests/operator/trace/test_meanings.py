"""What transactions mean where they cover points: in facts of the trace, in the rows of `trace`. In virtual time."""

import asyncio

import pytest

from gateway.cli.show.trace_rows import rows
from gateway.errors import WrongQuestion
from gateway.operator.operations.asked import Traced
from gateway.operator.operator import Operator
from gateway.operator.trace.reader import Texts, TraceReader
from kit.asking import answers
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[profile.meter]
points = [
  { name = "power", holding = 0, type = "int32", unit = "kW", scale = 0.1, decimals = 1 },
  { name = "state", holding = 2, labels = { 1 = "running" } },
  { name = "energy", holding = 10, type = "uint32", scale_from = "energy-sf", write = true },
  { name = "energy-sf", holding = 13, type = "int16" },
  { name = "alarm", coils = 3, write = true },
  { name = "flow", input = 5, invalid = 0x8000, unit = "l/s" },
  { name = "limit", holding = 2, write = true, write_at = 30 },
  { name = "low", holding = 40, bits = "0-3", write = true },
  { name = "high", holding = 40, bits = "4-7", write = true },
]

[[line]]
name = "hall"
port = "/dev/hall"
timeout = "100 ms"
devices = [{ unit = 1, name = "meter", profile = "meter" }, { unit = 6, name = "press" }]

[[access]]
listen = ["control"]
allow = ["read", "write"]
"""
MIRROR = """
[[image]]
unit = 241
name = "copy"
of = "meter"
read = [{ holding = "0-1", every = "1 s" }]
"""


@pytest.fixture
async def bench():
    async with gateway_bench(CONFIG) as bench:
        attach(bench)
        yield bench


def attach(bench):
    devices = bench.devices = {unit: SimulatedDevice(unit) for unit in (1, 6)}
    devices[1].holding[:3] = [0, 1234, 1]
    bench.attach("hall", SimulatedLine("rtu", *devices.values()))


async def told(bench, pdu, unit=1):
    """The fact of a request, as the trace tells it."""
    await answers(bench.running, {"verb": "request", "unit": unit, "pdu": pdu})
    question = {"verb": "trace", "since": 60, "points": True}
    (page,) = await answers(bench.running, question)
    return [fact for fact in page["facts"] if fact.get("client") == "control"][-1]


def in_words(fact):
    return [f"{each['point']} {each['text']}" for each in fact.get("points", ())]


@pytest.mark.parametrize(
    ("pdu", "meaning"),
    [
        ("03 00 00 00 03", ["power 123.4 kW", "state running", "limit 1"]),
        ("03 00 01 00 02", ["state running", "limit 1"]),  # half of a point says nothing
        ("04 00 05 00 01", ["flow 0 l/s"]),
        ("01 00 00 00 08", ["alarm 0"]),
        ("05 00 03 FF 00", ["alarm 1"]),
        ("0F 00 00 00 08 01 08", ["alarm 1"]),
        ("06 00 1E 00 07", ["limit 7"]),
        ("06 00 02 00 07", []),  # that is not where the limit is written
        ("06 00 28 00 A5", ["low 5", "high 10"]),
        ("10 00 0A 00 02 04 00 00 00 01", []),  # its scale is not known
        ("17 00 00 00 02 00 1E 00 01 02 00 08", ["limit 8", "power 123.4 kW"]),
        ("03 00 64 00 03", []),
        ("2B 0E 01 00", []),
    ],
)
async def test_a_transaction_means_the_points_that_it_has_whole(bench, pdu, meaning):
    fact = await told(bench, pdu)
    assert in_words(fact) == meaning
    assert ("points" in fact) == bool(meaning)


async def test_a_value_is_told_as_a_number_too(bench):
    fact = await told(bench, "03 00 00 00 02")
    assert fact["points"] == [{"point": "power", "value": 123.4, "text": "123.4 kW"}]
    assert fact["more_points"] == 0


async def test_a_device_that_has_no_value_says_so(bench):
    bench.devices[1].input[5] = 0x8000
    assert (await told(bench, "04 00 05 00 01"))["points"] == [
        {"point": "flow", "value": None, "text": "\N{EN DASH} l/s"}
    ]


async def test_a_scale_counts(bench):
    bench.devices[1].holding[10:14] = [0, 7, 0, 2]
    assert in_words(await told(bench, "03 00 0A 00 04")) == ["energy 700", "energy-sf 2"]


async def test_an_exception_and_a_time_out_have_no_values_to_tell_but_those_written(bench):
    bench.devices[1].silent = True
    assert "points" not in await told(bench, "03 00 00 00 02")
    assert in_words(await told(bench, "06 00 1E 00 07")) == ["limit 7"]


async def test_a_device_without_points_has_no_meaning(bench):
    assert "points" not in await told(bench, "03 00 00 00 02", unit=6)


async def test_the_poll_of_a_mirror_means_the_points_of_its_device_and_its_answer_those_of_the_mirror():
    async with gateway_bench(CONFIG + MIRROR) as bench:
        attach(bench)
        await asyncio.sleep(10)
        await told(bench, "03 00 00 00 02", unit=241)
        (page,) = await answers(bench.running, {"verb": "trace", "since": 3, "points": True})
    meanings = {(fact["kind"], *in_words(fact)) for fact in page["facts"]}
    assert meanings == {("exchange", "power 123.4 kW"), ("answered", "power 123.4 kW")}


async def test_only_the_first_points_are_told_and_the_others_when_somebody_looks(bench):
    fact = await told(bench, "03 00 00 00 32")
    assert in_words(fact) == ["power 123.4 kW", "state running", "limit 1"]
    assert fact["more_points"] == 4
    question = {"verb": "meaning", "unit": "meter", "request": fact["request"], "response": fact["response"]}
    (answer,) = await answers(bench.running, question)
    assert [each.point for each in answer["points"]] == [
        "power",
        "state",
        "limit",
        "energy",
        "energy-sf",
        "low",
        "high",
    ]


@pytest.mark.parametrize("wrong", [{"request": ""}, {"response": "03"}, {"response": "83"}, {"response": "03 04 01"}])
async def test_bytes_that_are_no_transaction_mean_nothing(bench, wrong):
    question = {"verb": "meaning", "unit": "meter", "request": "03 00 00 00 02", "response": ""} | wrong
    (answer,) = await answers(bench.running, question)
    assert answer["points"] == ()


async def test_what_is_no_hexadecimal_is_refused(bench):
    with pytest.raises(WrongQuestion, match="must be bytes in hexadecimal"):
        await answers(bench.running, {"verb": "meaning", "unit": "meter", "request": "no"})


async def test_the_rows_of_the_trace_say_it_beside_the_numbers(bench):
    fact = await told(bench, "03 00 00 00 32")
    _, came = rows(fact)
    assert "  (power 123.4 kW, state running, limit 1, 4 more)  [" in came.text
    assert came.text.startswith("0 1234 1 0")


async def test_nobody_pays_for_it_who_does_not_ask(bench):
    await told(bench, "03 00 00 00 02")
    (page,) = await answers(bench.running, {"verb": "trace", "since": 60})
    assert [fact for fact in page["facts"] if "points" in fact] == []


LIMITED = f"{CONFIG}\n[[access]]\nlisten = ['web']\nunits = [6]\nallow = ['read']\n"


async def test_who_may_not_see_the_bytes_does_not_see_what_they_mean(tmp_path):
    async with web_bench(LIMITED, tmp_path) as web:
        attach(web.inner)
        await answers(web.running, {"verb": "request", "unit": 1, "pdu": "03 00 00 00 03"})
        for path in ("/traffic", "/lines/hall"):
            page = await web.browser().get(path)
            assert page.status == 200
            assert "123.4" not in page.text
            assert "running" not in page.text.partition("<tbody>")[2]
        reader = TraceReader(Operator(web.running, None), Traced(since=60, points=True), "127.0.0.1", Texts())
        assert "123.4" not in "".join(await reader.next(0.1))
    async with web_bench(CONFIG, tmp_path) as web:
        attach(web.inner)
        await answers(web.running, {"verb": "request", "unit": 1, "pdu": "03 00 00 00 03"})
        assert "<b>power 123.4 kW, state running, limit 1</b>" in (await web.browser().get("/traffic")).text
        reader = TraceReader(Operator(web.running, None), Traced(since=60, points=True), "127.0.0.1", Texts())
        assert "123.4 kW" in "".join(await reader.next(0.1))
