"""The page of a virtual unit: of which device each value is, how old it is, and what it means."""

import asyncio
import re

import pytest

from gateway.operator.images.grid import MOST
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.mapped_hall import CONFIG, attach

PAGE = "/images/block"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
async def meters(bench):
    """The meters, all of which have answered."""
    meters = attach(bench.inner)
    meters["meter-1"].holding[0], meters["meter-1"].holding[8], meters["meter-3"].holding[0] = 125, 1, 30
    meters["meter-2"].holding[100:104] = [7, 8, 9, 10]
    await asyncio.sleep(10)
    return meters


def lines(page: str) -> dict[str, list[str]]:
    """The values by their places: point, source, value, unit of measure, age and state as text."""
    found = {}
    for row in re.findall(r'<tr data-line="[^"]*">(.*?)</tr>', page, re.DOTALL):
        place, *cells = [" ".join(re.sub(r"<[^>]*>", " ", cell).split()) for cell in re.split(r"</t[hd]>", row)[:-1]]
        found[place] = cells
    return found


async def shown(bench, path: str = PAGE) -> dict[str, list[str]]:
    found = lines((await bench.browser().get(path)).text)
    return {place: [*cells[:4], cells[5]] for place, cells in found.items()}


async def test_each_value_has_its_source_its_meaning_and_its_state(bench, meters):
    assert await shown(bench) == {
        "holding 0 (40001)": ["meter-1.power", "meter-1 power", "12.5", "kW", "fresh"],
        "holding 1-2 (40002)": ["meter-3.power", "meter-3 power", "3.0", "kW", "fresh"],
        "holding 3 (40004)": ["meter-1.mode", "meter-1 mode", "run", "", "fresh"],
        "holding 20 (40021)": ["", "meter-2 holding 100", "7", "", "fresh"],
        "holding 21 (40022)": ["", "meter-2 holding 101", "8", "", "fresh"],
        "holding 22 (40023)": ["", "meter-2 holding 102", "9", "", "fresh"],
        "holding 23 (40024)": ["", "meter-2 holding 103", "10", "", "fresh"],
        "holding 90.0 (40091.0)": ["meter-1.fresh", "meter-1 fresh", "1", "", ""],
        "holding 90.1 (40091.1)": ["meter-2.fresh", "meter-2 fresh", "1", "", ""],
        "holding 90.2 (40091.2)": ["meter-3.fresh", "meter-3 fresh", "1", "", ""],
        "holding 91 (40092)": ["meter-2.age", "meter-2 age", "0", "s", ""],
    }


async def test_it_leads_to_the_pages_of_its_sources_and_they_lead_back(bench, meters):
    page = (await bench.browser().get(PAGE)).text
    assert '<a href="/units/meter-2">meter-2</a>' in page
    assert '<a href="/images/block">mapped by block</a>' in (await bench.browser().get("/units/meter-2")).text
    assert (await bench.browser().get("/units/block")).headers["Location"] == PAGE


async def test_what_is_stale_unknown_or_invalid_is_told(bench, meters):
    meters["meter-1"].holding[0], meters["meter-2"].silent = 0x8000, True
    await asyncio.sleep(8)
    found = await shown(bench)
    assert found["holding 0 (40001)"] == ["meter-1.power", "meter-1 power", "\u2013", "kW", "invalid"]
    assert found["holding 3 (40004)"][2:] == ["run", "", "fresh"]
    assert found["holding 21 (40022)"][2:] == ["(8)", "", "stale"]
    assert found["holding 90.1 (40091.1)"][2] == "0"
    await bench.inner.client().asks(240, "06 00 15 00 07")
    assert (await shown(bench))["holding 21 (40022)"][2:] == ["\u2013", "", "unknown"]
    values = (await bench.browser().get("/api/v1/images/block/holding/0-23")).json["values"]
    states = {each["address"]: (each["state"], each["value"], each["source"]) for each in values}
    assert states[0] == ("invalid", None, "meter-1 power")
    assert states[3] == ("fresh", 1, "meter-1 mode")
    assert states[21] == ("unknown", None, "meter-2 holding 100-103")


async def test_a_value_over_two_rows_is_known_only_if_both_are(bench):
    attach(bench.inner)["meter-3"].silent = True
    await asyncio.sleep(10)
    values = (await bench.browser().get("/api/v1/images/block/holding/0-1?type=uint32")).json["values"]
    assert [(each["state"], each["source"]) for each in values] == [("unknown", "meter-1 power, meter-3 power")]
    values = (await bench.browser().get("/api/v1/images/block/holding/0-1")).json["values"]
    assert [each["state"] for each in values] == ["fresh", "unknown"]


async def test_its_sources_are_told_as_a_whole(bench, meters):
    meters["meter-3"].silent = True
    await asyncio.sleep(8)
    page = (await bench.browser().get(PAGE)).text
    assert "virtual unit with values of 3 sources" in page
    assert "values older than 3000 ms are stale" in page
    sources = page[page.index('id="sources"') :]
    rows = re.findall(r'meter-(\d)</a></th><td class="number">(\d of \d)</td>.*?class="state (\w+)"', sources)
    assert rows == [("1", "2 of 2", "up"), ("3", "0 of 1", "failing"), ("2", "1 of 1", "up")]


async def test_its_own_registers_are_shown_as_those_of_an_image(bench, meters):
    await bench.inner.client("10.0.0.7:5000").asks(240, "06 00 C8 00 2A")
    await asyncio.sleep(1)
    await bench.inner.client("10.0.0.8:6000").asks(240, "06 00 15 00 07")
    await asyncio.sleep(2)
    page = (await bench.browser().get(PAGE)).text
    assert re.search(r'<td data-at="200" title="10.0.0.7:5000">42</td>', page)
    assert re.search(r'<td data-at="21" data-names="meter-2 holding 100-103" title="[^"]*10.0.0.8:6000">7</td>', page)
    assert re.search("holding 21</th><td>10.0.0.8:6000.*holding 200</th><td>10.0.0.7:5000", page, re.DOTALL)


async def test_it_is_told_in_chinese(bench, meters):
    page = (await bench.browser().get(f"{PAGE}?lang=zh")).text
    assert "虚拟单元" in page
    assert "数值来自 3 个来源" in page
    assert "数值来源" in page
    assert "1 / 1" in page


async def test_the_overview_lists_it(bench, meters):
    meters["meter-3"].silent = True
    await asyncio.sleep(8)
    page = (await bench.browser().get("/")).text
    assert '<a href="/images/block">block</a></td><td>virtual unit · 2 of 3 sources fresh</td>' in page


async def test_the_traffic_says_of_which_devices_a_read_was_and_to_which_one_a_write_went(bench, meters):
    client = bench.inner.client()
    await client.asks(240, "03 00 00 00 03")
    await client.asks(240, "06 00 15 00 07")
    page = (await bench.browser().get("/traffic?unit=block")).text
    assert "values of meter-1, meter-3" in page
    assert "meter-2 · asked at address 2 for 10.0.0.9:49152" in page
    assert "asked at address 2 for 10.0.0.9:49152" in (await bench.browser().get("/traffic?unit=meter-2")).text


async def test_why_a_write_through_it_failed_is_told_on_the_page_of_its_device(bench, meters):
    meters["meter-2"].silent = True
    assert await bench.inner.client().asks(240, "06 00 15 00 07") == "86 0B"
    assert "10.0.0.9:49152: write holding 101 (40102): 7" in (await bench.browser().get("/units/meter-2")).text


async def test_who_may_not_read_it_sees_no_values(tmp_path):
    async with web_bench(CONFIG + '[[access]]\nlisten = ["web"]\nfunctions = [1]\n', tmp_path) as bench:
        attach(bench.inner)
        await asyncio.sleep(5)
        page = (await bench.browser().get(PAGE)).text
        assert lines(page) == {}
        assert "You may not read this." in page


async def test_a_large_one_is_shown_in_parts(tmp_path):
    rows = ",\n".join(f'{{ at = {at}, device = "meter", holding = "{at}", every = "1 min" }}' for at in range(1000))
    config = f"""
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{{ unit = 1, as = 41, name = "meter" }}]
[[image]]
unit = 240
name = "block"
stale = "5 min"
map = [
{rows}
]
"""
    async with web_bench(config, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, items=1000)))
        await asyncio.sleep(70)
        at, seen = PAGE, []
        while at:
            page = (await bench.browser().get(at)).text
            found = list(lines(page))
            assert len(found) <= MOST
            seen += found
            following = re.search(r'<a href="([^"]*)" rel="next"', page)
            at = following and PAGE + following[1].replace("&amp;", "&")
        assert seen == [f"holding {at} ({40001 + at})" for at in range(1000)]


async def test_an_operator_writes_a_point_to_its_device(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        meter = attach(bench.inner)["meter-1"]
        await asyncio.sleep(5)
        anna = bench.browser()
        await anna.log_in("anna")
        page = (await anna.get(PAGE)).text
        names = re.findall(r'<input type="hidden" name="point" value="([^"]*)">', page)
        assert names == ["meter-1.mode"]
        question = (await anna.post("/units/block/writes", {"point": "meter-1.mode", "value": "run"})).headers[
            "Location"
        ]
        await anna.post(question, {})
        assert meter.holding[8] == 1
