"""Rows of [[access]] for addresses: who may not read a register sees neither its value nor its trend, nor its bytes."""

import asyncio
import json
import re

import pytest

from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[listen]]
name = "plant"
bind = "tcp://0.0.0.0:5020"

[[line]]
name = "hall"
port = "/dev/hall"

[[line.devices]]
unit = 1
as = 41
name = "silo"
profile = "few"
points = [
    { name = "level", holding = 0, write = true },
    { name = "recipe", holding = 1, write = true },
    { name = "mode", holding = 2 },
    { name = "count", holding = 5 },
]

[[image]]
unit = 200
name = "shift"
holding = "0-20"
profile = "shift"

[profile.few]
max_gap = 8

[profile.shift]
points = [{ name = "first", holding = 0 }, { name = "second", holding = 1 }]

[[access]]
listen = ["web"]
holding = ["1", "3"]
allow = []

[[access]]
listen = ["web"]
holding = "2-20"
allow = ["read"]

[[access]]
allow = ["read", "write"]
listen = ["web"]

[[access]]
listen = ["plant"]
from = ["127.0.0.0/8"]
allow = ["read", "write"]

[[access]]
listen = ["plant"]
from = ["10.0.0.0/8"]
holding = "7"
allow = ["read", "write"]
"""
UNIT, API = "/units/silo", "/api/v1/units/41"


@pytest.fixture
def device():
    return SimulatedDevice(1)


@pytest.fixture
async def bench(tmp_path, device):
    async with web_bench(CONFIG, tmp_path, trends=86400.0) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        device.holding[:6] = [10, 11111, 12, 13, 14, 15]
        await asyncio.sleep(1)
        yield bench


def points(page: str) -> dict[str, str]:
    """The values of points on the page of a unit, by name."""
    rows = re.findall(r'<tr data-point="(\w+)">(.*?)</tr>', page, re.DOTALL)
    cells = {name: re.findall(r"<td.*?>(.*?)</td>", row, re.DOTALL) for name, row in rows}
    return {name: re.sub(r"<[^>]+>|\s+", " ", found[1]).strip() for name, found in cells.items()}


async def hears(bench) -> None:
    """A client that may read all of it does so."""
    await bench.inner.client().asks(41, "03 0000 0006")
    await asyncio.sleep(1.5)


async def test_what_others_have_read_is_shown_but_for_the_registers_that_are_refused(bench):
    await hears(bench)
    browser = bench.browser()
    page = (await browser.get(UNIT)).text
    assert points(page) == {"level": "10", "recipe": "\u2013", "mode": "12", "count": "15"}
    for path in ("/values", "/values.csv", "/api/v1/values", f"{UNIT}?trend=recipe", "/traffic"):
        text = (await browser.get(path)).text
        assert "11111" not in text, path
    assert "15" in (await browser.get("/values.csv")).text


async def test_a_trend_is_told_of_a_point_that_may_be_read_only(bench):
    await hears(bench)
    browser = bench.browser()
    assert (await browser.get("/api/v1/values/silo/level/history")).status == 200
    refused = await browser.get("/api/v1/values/silo/recipe/history")
    assert (refused.status, refused.json["exception"]) == (403, 1)


async def test_points_are_read_around_what_is_refused(bench, device):
    told = (await bench.browser().get(f"{API}/points")).json
    assert {each["point"]: each["value"] for each in told["values"]} == {"level": 10, "mode": 12, "count": 15}
    assert [(each["address"], each["exception"]) for each in told["errors"]] == [(1, 1)]
    # 3 lies between 2 and 5, and is refused too
    assert sorted(frame.pdu.hex(" ") for frame in device.heard) == [
        "03 00 00 00 01", "03 00 02 00 01", "03 00 05 00 01",
    ]  # fmt: skip


async def test_a_read_over_a_refused_register_is_refused_whole_and_told_once(bench, device):
    browser = bench.browser()
    refused = await browser.get(f"{API}/holding/0-2")
    assert (refused.status, refused.json["exception"]) == (403, 1)
    assert device.heard == []
    (event,) = bench.events("access_denied")
    assert (event.refused_at, event.function) == ("holding 1", 3)
    assert (await browser.get(f"{API}/holding/5-9")).status == 200


async def test_the_trace_has_the_bytes_of_reads_only_that_its_reader_may_make(bench):
    await hears(bench)
    client = bench.inner.client()
    await client.asks(41, "03 0002 0001")
    await client.asks(41, "06 0002 0001")
    wire = bench.browser().open("/api/v1/trace?seconds=60")
    await asyncio.sleep(1)
    facts = [json.loads(line[6:]) for line in wire.received.decode().splitlines() if line.startswith("data: ")]
    wire.close()
    assert [each["response"] for each in facts if each["kind"] == "exchange"] == [None, "03 02 00 0C", None]


async def test_an_image_is_shown_but_for_the_registers_that_are_refused(bench):
    client = bench.inner.client()
    await client.asks(200, "10 0000 0003 06 0001 2B67 0003")
    browser = bench.browser()
    page = (await browser.get("/images/shift")).text
    assert "11111" not in page
    assert points(page) == {"first": "1", "second": "\u2013"}
    assert [int(at) for at in re.findall(r'data-at="(\d+)"', page)] == [0, 2, *range(4, 21)]
    assert (await browser.get("/api/v1/images/shift/holding/0-2")).json["exception"] == 1
    assert (await browser.get("/api/v1/images/shift/holding/2-2")).json["values"][0]["value"] == 3


async def test_an_operator_writes_where_it_is_allowed(bench, device):
    anna = bench.browser()
    await anna.log_in("anna")
    page = (await anna.get(UNIT)).text
    assert "New value of level" in page
    assert "New value of recipe" not in page
    refused = await anna.post(f"{UNIT}/writes", {"point": "recipe", "value": "1"})
    assert (refused.status, refused.json["exception"]) == (403, 1)
    assert "[[access]] does not let web:anna@127.0.0.1 write holding 1" in refused.problem
    assert device.heard == []


@pytest.mark.parametrize(
    ("function", "address", "verdict"),
    [
        (6, "", "that depends on the address"),
        (3, "7", "allowed"),
        (16, "7", "allowed"),
        (3, "8", "not allowed"),
        (23, "7", "allowed"),
        (1, "7", "not allowed"),
        (8, "", "not allowed"),
        (3, "65536", "“65536” is no address"),
    ],
)
async def test_the_form_asks_for_an_address(bench, function, address, verdict):
    query = f"from=10.0.0.1&listener=plant&unit=41&function={function}&address={address}"
    page = Markup((await bench.browser().get(f"/clients?{query}")).text)
    assert any(text.replace('"', "“", 1).replace('"', "”").startswith(verdict) for text in page.texts), page.texts
    rows = [row for row in page.rows() if row[0] == "10.0.0.0/8"]
    assert all(row[3:5] == ["holding 7", "read, write"] for row in rows)


async def test_a_client_whose_only_right_is_to_an_address_is_admitted(bench):
    rights = bench.running.gateway.listeners[0].router.rights
    assert rights.admits("10.0.0.1")
    assert rights.names("10.0.0.1")
    assert not rights.admits("192.168.0.1")
