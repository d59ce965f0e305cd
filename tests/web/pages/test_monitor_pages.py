"""What pages, inventory and metrics tell of a line where the gateway only listens."""

import asyncio

import pytest

from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup
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
devices = [{ unit = 3, as = 63, name = "boiler", points = [{ name = "power", holding = 0 }] }]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        others = Others(bench.inner.lines["plc"], SimulatedDevice(3, delay=0.02))
        await asyncio.sleep(6.0)
        for _ in range(10):
            await others.ask(3, "03 0000 0002")
        await others.ask(9, "03 0000 0002")
        await asyncio.sleep(6.0)
        yield bench
        assert bench.inner.lines["plc"].written == b""


async def test_the_overview_has_a_row_of_it(bench):
    page = await bench.browser().get("/")
    assert "Lines on which the gateway only listens" in page.text
    (row,) = [row for row in Markup(page.text).rows() if row[0] == "old-plc"]
    assert (row[1], row[4:6]) == ("up", ["11", "RTU 9600 8E1"])


@pytest.mark.parametrize(
    ("language", "expected"),
    [
        ("en", ("What is heard", "11 requests, 10 of them with an answer; values of 10 were taken.", "9: 1")),
        ("zh", ("监听内容", "共 11 个请求", "9: 1")),
    ],
)
async def test_its_page_says_what_is_heard_and_who_is_not_configured(bench, language, expected):
    page = await bench.browser().get(f"/lines/old-plc?lang={language}")
    assert [each for each in expected if each not in page.text] == []
    assert "/config/line?line=" not in page.text  # nothing can be searched there


async def test_a_line_that_asks_has_no_such_section(bench):
    assert "What is heard" not in (await bench.browser().get("/lines/hall")).text


async def test_the_page_of_its_unit_has_values_and_asks_for_none(bench):
    page = await bench.browser().get("/units/boiler")
    assert "power" in page.text
    assert "Others ask this unit, and the gateway only listens" in page.text
    assert "Read all points" not in page.text
    assert "Read values" not in page.text
    assert "Read values" in (await bench.browser().get("/units/silo")).text


async def test_of_a_unit_that_others_ask_it_is_not_said_that_nobody_has_asked_it(bench):
    page = await bench.browser().get("/units/boiler")
    assert "Others ask this unit, so there is no limit" in page.text
    assert "Nobody has asked this unit yet" not in page.text


async def test_the_inventory_has_it(bench):
    told = (await bench.browser().get("/api/v1/inventory")).json
    assert [(each["name"], each["role"]) for each in told["lines"]] == [("hall", "client"), ("old-plc", "monitor")]
    assert ("boiler", "old-plc") in [(each["name"], each["line"]) for each in told["devices"]]


async def test_the_lines_of_the_api(bench):
    (line,) = (await bench.browser().get("/api/v1/lines")).json["monitors"]
    assert (line["name"], line["counts"]["requests"]) == ("old-plc", 11)
    assert (await bench.browser().get("/api/v1/lines/old-plc")).json["counts"]["sure"] == 10


async def test_metrics_count_what_is_heard(bench):
    text = (await bench.browser().get("/metrics")).text
    assert 'modbus_gateway_line_up{line="old-plc"} 1.0' in text
    assert 'modbus_gateway_heard_total{kind="requests",line="old-plc"} 11.0' in text
    assert 'modbus_gateway_heard_total{kind="answers",line="old-plc"} 10.0' in text
    of_line = "".join(each for each in text.splitlines() if "old-plc" in each)
    assert "unit_timeout_limit_seconds" not in of_line
    assert "unit_up" not in of_line  # whether it would answer is not known


async def test_a_line_that_answers_nobody_makes_nothing_ready(bench):
    bench.inner.lines["hall"].pull()
    await asyncio.sleep(1.0)
    assert (await bench.browser().get("/readyz")).status == 503
