"""The page of a line over an hour and a day: of the ring where that reaches back, and else of the history."""

import asyncio
import json
import re
from html import unescape

import pytest

from gateway.timing.history import STEP, LineUse, UnitUse
from kit.browser import CLOCK, web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[trace]
ring = "64 KiB"

[[line]]
name = "hall"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 2, as = 42, name = "oven" }]

[[line]]
name = "panel"
port = "/dev/panel"
role = "server"
serves = [41]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        yield bench


async def past(bench, span):
    """What the page tells a script of the columns, or nothing."""
    text = (await bench.browser().get(f"/lines/hall?span={span}")).text
    found = re.search(r'data-past="([^"]*)"', text)
    return json.loads(unescape(found[1])) if found else None


def fill(bench):
    """Something for the present slot of the history."""
    unit = UnitUse(requests=40, timeouts=2, exceptions=1, responses=38, answer=0.38)
    bench.history.add(CLOCK, {"hall": LineUse(20, 10, 0, 40, 2)}, {"silo": unit})


async def test_the_hour_has_a_column_for_each_minute_with_what_units_and_clients_did(bench):
    await asyncio.sleep(120)
    client = bench.inner.client("10.2.0.7:5000")
    for pdu in ("03 00 00 00 02", "03 00 00 00 01", "03 01 00 00 01"):
        await client.asks(41, pdu)
    await client.asks(42, "03 00 00 00 01")
    told = await past(bench, "1h")
    assert told["step"] == 60
    assert len(told["line"]) == 60
    assert told["line"][0] is None  # the gateway did not run
    busy, sent, failed, clients = told["line"][-1]
    assert (sent, failed, clients) == (4, 1, {"10.2.0.7:5000": 4})
    assert 0 < busy < 1
    requests, timeouts, other, unsent, exceptions, answer = told["units"]["silo"][-1]
    assert (requests, timeouts, other, unsent, exceptions) == (3, 0, 0, 0, 1)
    assert answer > 0
    assert told["units"]["oven"][-1][:4] == [1, 1, 0, 0]
    assert told["units"]["oven"][-2] == [0, 0, 0, 0, 0, 0.0]


async def test_a_ring_that_does_not_reach_back_leaves_it_to_the_history(bench):
    client = bench.inner.client("10.2.0.7:5000")
    for _ in range(400):
        await client.asks(41, "03 00 00 00 02")
    fill(bench)
    assert bench.running.ring.first > 0
    told = await past(bench, "1h")
    assert told["step"] == STEP
    assert len(told["line"]) == 6
    assert told["line"][-1] == [0.5, 40, 2, {}]


async def test_the_day_is_out_of_the_history(bench):
    fill(bench)
    told = await past(bench, "24h")
    assert (told["step"], len(told["line"])) == (STEP, 144)
    assert told["line"][-1] == [0.5, 40, 2, {}]
    assert told["units"]["silo"][-1] == [40, 2, 0, 0, 1, 10.0]


@pytest.mark.parametrize("span", ["", "2h", "1h%27", "-1"])
async def test_another_span_shows_the_last_transactions_only(bench, span):
    assert await past(bench, span) is None


async def test_a_line_where_the_gateway_is_asked_has_no_such_picture(bench):
    text = (await bench.browser().get("/lines/panel?span=1h")).text
    assert "data-past=" not in text
    assert "span=1h" not in text.partition("<main")[2]
