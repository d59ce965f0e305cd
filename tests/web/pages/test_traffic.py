"""The page of the traffic: what the address chooses, in words, complete without JavaScript."""

import asyncio
import json

import pytest

from gateway.operator.values.requests import AwaitedOrigin
from gateway.request import Request
from gateway.trace.records import Heard, PortChanged
from gateway.web.pages.traffic import MOST_ROWS
from kit.asking import ask
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall <b>"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]

[[image]]
unit = 200
name = "shift"
holding = 10
"""
LIMITED = """
[[access]]
listen = ["web"]
units = [46]
allow = ["read"]
[[access]]
listen = ["control"]
allow = ["read", "write"]
"""


@pytest.fixture
async def bench(tmp_path):
    """After a read, a write, an exception, a time-out, an image that was read, and a unit without a route."""
    async with web_bench(CONFIG, tmp_path) as bench:
        await some(bench)
        yield bench


async def some(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
    await asyncio.sleep(0.1)
    one, other = bench.inner.client("10.2.0.7:5000"), bench.inner.client("10.2.0.8:5000")
    for client, unit, pdu in [
        (one, 46, "03 00 00 00 02"),
        (other, 46, "06 00 01 00 07"),
        (one, 46, "03 00 C8 00 01"),
        (one, 47, "03 00 00 00 01"),
        (one, 200, "03 00 00 00 01"),
        (one, 99, "03 00 00 00 01"),
    ]:
        await client.asks(unit, pdu)


async def rows(bench, path="/traffic", host="127.0.0.1", **headers):
    """The rows of the table, each as the texts of its cells."""
    page = await bench.browser(host).get(path, **headers)
    assert page.status == 200, page.text
    return Markup(page.text).rows()


def told(row):
    """What a row says without its time."""
    return " | ".join(row[1:])


async def test_all_kinds_of_transactions_are_shown_in_words_the_newest_first(bench):
    ring, now = bench.running.ring, asyncio.get_running_loop().time
    ring.add(Heard(now(), "hall <b>", "another client", bytes.fromhex("09 03 02 00 01"), 5))
    ring.add(PortChanged(now(), "hall <b>", "unplugged"))
    lost, heard, no_route, image, timeout, exception, write, read, *_ = map(told, await rows(bench))
    assert "read holding 0-1 (40001-40002)" in read
    assert "| ok | 0 0 |" in read
    assert "46 press" in read
    assert "10.2.0.7:5000" in read
    assert "write holding 1 (40002): 7" in write
    assert "10.2.0.8:5000" in write
    assert "exception 02, illegal data address" in exception
    assert "time-out" in timeout
    assert "200 shift" in image
    assert "not sent" in no_route
    assert "no such unit" in no_route
    assert "foreign traffic" in heard
    assert "unplugged" in lost


async def test_a_row_opens_to_its_frames_without_javascript(bench):
    markup = Markup((await bench.browser().get("/traffic?unit=46&function=3&result=ok")).text)
    assert [tag for tag, _ in markup.tags].count("details") == 1
    assert {"03 00 00 00 02", "03 04 00 00 00 00"} <= set(markup.texts)
    assert any("asked at address 6 for 10.2.0.7:5000, limit" in text for text in markup.texts)


@pytest.mark.parametrize(
    ("query", "units"),
    [
        ("line=hall+%3Cb%3E", ["47 oven", "46 press", "46 press", "46 press"]),
        ("unit=press", ["46 press"] * 3),
        ("unit=200", ["200 shift"]),
        ("function=6", ["46 press"]),
        ("client=10.2.0.8", ["46 press"]),
        ("client=+10.2.0.8+", ["46 press"]),
        ("result=no_route", ["99"]),
        ("result=failed&client=10.2.0.7", ["99", "47 oven"]),
        ("line=&unit=&function=&client=10.2.0.8&result=&lang=en", ["46 press"]),
        ("client=10.2.0", []),
    ],
)
async def test_the_address_chooses(bench, query, units):
    assert [row[2] for row in await rows(bench, f"/traffic?{query}") if row[2]] == units


async def test_the_form_and_the_file_have_what_the_address_chooses(bench):
    text = (await bench.browser().get('/traffic?unit=46&function=3&client="><b>&result=ok')).text
    for value in ("46", "3", "ok"):
        assert f'<option value="{value}" selected>' in text
    assert 'value="&#34;&gt;&lt;b&gt;"' in text
    query = "unit=46&amp;function=3&amp;client=%22%3E%3Cb%3E&amp;result=ok"
    assert f'href="/api/v1/trace.pcapng?{query}&amp;seconds=300"' in text
    assert f'data-live="{query}"' in text


@pytest.mark.parametrize(
    ("query", "why"),
    [("unit=nobody", "nobody"), ("line=x", "no line"), ("function=x", "whole number"), ("result=good", "no result")],
)
async def test_what_makes_no_sense_is_told_on_the_page(bench, query, why):
    page = await bench.browser().get(f"/traffic?{query}")
    assert page.status == 200
    alerts = [attributes for _, attributes in Markup(page.text).tags if attributes.get("role") == "alert"]
    assert len(alerts) == 1
    assert why in page.text


async def test_nothing_like_it_is_said(bench):
    assert "No transaction like this is in memory." in (await bench.browser().get("/traffic?client=nobody")).text


async def test_the_page_is_bounded_and_has_the_newest(bench):
    ring, now = bench.running.ring, asyncio.get_running_loop().time
    for at in range(1000):
        request = Request(200, b"\x03" + at.to_bytes(2, "big") + b"\0\1", AwaitedOrigin(lambda: True), now())
        ring.answer(request, b"\x03\x02\0\0", now(), "shift")
    found = await rows(bench)
    assert len(found) == MOST_ROWS
    assert "read holding 999 " in told(found[0])
    assert "46 press" in told((await rows(bench, "/traffic?unit=46"))[0])


async def test_a_script_gets_the_records_and_the_settings_of_the_lines(bench):
    tags = Markup((await bench.browser().get("/traffic?unit=46&result=ok&function=3")).text).tags
    (fact,) = [json.loads(attributes["data-fact"]) for _, attributes in tags if "data-fact" in attributes]
    assert (fact["unit"], fact["response"]) == (46, "03 04 00 00 00 00")
    (table,) = [attributes for tag, attributes in tags if tag == "table"]
    assert json.loads(table["data-lines"]) == {"hall <b>": ["rtu", 19200, "8E1"]}


async def test_what_a_visitor_may_not_read_is_withheld(tmp_path):
    async with web_bench(CONFIG + LIMITED, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6), SimulatedDevice(7)))
        for unit in (46, 47):
            await ask(bench.running, "request", unit=unit, pdu="04 0000 0001")
        oven, press = map(told, (await rows(bench))[:2])
        assert "read input 0" in press
        assert "withheld" in oven
        assert "read input" not in oven
        assert "04 00 00 00 01" not in json.dumps(await rows(bench, "/traffic?unit=47"))


async def test_it_is_shown_to_those_who_may_read(bench):
    page = await bench.browser("10.0.0.9").get("/traffic?unit=46")
    assert (page.status, page.headers["Location"]) == (303, "/login?next=/traffic?unit%3D46")


async def test_it_speaks_chinese(bench):
    read = told((await rows(bench, "/traffic?function=6", Accept_Language="zh"))[0])
    assert "写保持寄存器 1 (40002): 7" in read
    assert "已写入" in read


async def test_without_a_ring_it_says_how_to_have_one(tmp_path):
    async with web_bench(CONFIG + '[trace]\nring = "0"\n', tmp_path) as bench:
        assert "ring" in (await bench.browser().get("/traffic")).text


async def test_failures_are_found_however_much_has_happened_since(bench):
    ring, now = bench.running.ring, asyncio.get_running_loop().time
    for _ in range(30_000):
        ring.add(PortChanged(now(), "hall <b>", ""))
    assert [row[2] for row in await rows(bench, "/traffic?result=no_route")] == ["99"]
    assert [row[2] for row in await rows(bench, "/traffic?result=timeout")] == ["47 oven"]
