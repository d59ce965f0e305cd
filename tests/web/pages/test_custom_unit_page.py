"""The page of a unit made in Python: it is asked for its values, as a device is."""

import asyncio
import re

import pytest

from gateway.images.drivers.custom_driver import CustomDriver
from gateway.runtime import custom_images
from kit.browser import web_bench

CONFIG = """
[[image]]
unit = 60
name = "clock"
python = "units_for_pages:Clock"
timeout = "500 ms"
profile = "clock"

[profile.clock]
points = [{ name = "hour", holding = 0, unit = "h" }, { name = "alarm", holding = 5, write = true }]

[web]
bind = "http://127.0.0.1:8502"
"""
HALL = """
[[image]]
unit = 61
name = "hall"
map = [{ at = 0, device = "clock", holding = "0-1", every = "1 s" }]
"""
UNIT = """\
import asyncio
from gateway import CustomUnit, IllegalAddress

class Clock(CustomUnit):
    hangs = False

    async def read(self, area, address, count):
        if address + count > 3:
            raise IllegalAddress("it has three registers")
        self.hangs = self.hangs or count == 3
        if self.hangs:
            await asyncio.sleep(60)
        return [7, 30, 15][address : address + count]
"""


@pytest.fixture(params=[CONFIG + HALL])
async def bench(tmp_path, monkeypatch, request):
    (tmp_path / "units_for_pages.py").write_text(UNIT)
    monkeypatch.syspath_prepend(tmp_path)

    def in_this_loop(settings, unit, loop, emit, ring, _there, turn) -> CustomDriver:
        return CustomDriver(settings, unit, loop, emit, ring, None, turn)  # a thread has no virtual time

    monkeypatch.setattr(custom_images, "CustomDriver", in_this_loop)
    async with web_bench(request.param, tmp_path) as bench:
        yield bench


def row(page: str, point: str) -> str:
    found = re.search(rf'<tr data-point="{point}">(.*?)</tr>', page, re.DOTALL)
    assert found is not None
    return " ".join(re.sub(r"<[^>]+>", " ", found[1]).split())


async def test_it_says_what_it_is_and_is_found_from_everywhere(bench):
    browser = bench.browser()
    page = (await browser.get("/units/clock")).text
    assert "made in Python: units_for_pages:Clock · a request may take 500 ms" in page
    assert "mapped by hall" in page
    assert "Answer times and limits" not in page
    overview = (await browser.get("/")).text
    assert '<a href="/units/clock">clock</a></td><td>made in Python: units_for_pages:Clock</td>' in overview
    assert (await browser.get("/images/clock")).headers["location"] == "/units/clock"
    assert "用 Python 编写：units_for_pages:Clock" in (await browser.get("/units/clock", Accept_Language="zh")).text  # noqa: RUF001


async def test_its_points_are_known_when_they_were_read(bench):
    browser = bench.browser()
    assert row((await browser.get("/units/clock")).text, "hour").startswith("hour holding 0 (40001) – h")  # noqa: RUF001
    await browser.post("/units/clock/points")
    page = (await browser.get("/units/clock")).text
    assert "hour holding 0 (40001) 7 h" in row(page, "hour")
    assert "02" in row(page, "alarm")
    assert re.search(r"· [1-9] requests, [1-9] exceptions<", page)


async def test_other_registers_are_read_by_address(bench):
    page = (await bench.browser().get("/units/clock/values?area=holding&start=1&count=2")).text
    assert re.findall(r"<td[^>]*>(30|15)</td>", page) == ["30", "15"]


async def test_a_virtual_unit_has_its_values(bench):
    client = bench.inner.client()
    bench.running._start_units()
    await asyncio.sleep(2)
    assert await client.asks(61, "03 00 00 00 02") == "03 04 00 07 00 1E"


async def test_what_programs_get_of_it(bench):
    [status] = (await bench.browser().get("/api/v1/status")).json["images"]
    assert (status["name"], status["python"], status["timeout_ms"]) == ("clock", "units_for_pages:Clock", 500)
    units = (await bench.browser().get("/api/v1/units")).json["units"]
    assert {each["name"]: each["kind"] for each in units} == {"clock": "custom", "hall": "virtual"}


@pytest.mark.parametrize("bench", [CONFIG], indirect=True)
async def test_one_that_rests_is_a_trouble(bench):
    client, browser = bench.inner.client(), bench.browser()
    for _ in range(3):
        assert await client.asks(60, "03 00 00 00 03") == "83 0B"
    status = (await browser.get("/api/v1/status")).json
    assert [each["state"] for each in status["images"]] == ["resting"]
    [trouble] = status["troubles"]
    assert (trouble["kind"], trouble["page"], trouble["name"]) == ("resting", "units", "clock")
    assert re.search(
        r'<span class="state resting">resting</span> · next try in \d+ s', (await browser.get("/units/clock")).text
    )
    assert '<a href="/units/clock">clock</a>' in (await browser.get("/")).text.split('id="images"')[0]
