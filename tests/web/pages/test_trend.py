"""The trend of a point on the page of its unit, the sparkline beside a value, and who sees neither."""

import asyncio
import re
from contextlib import asynccontextmanager

import pytest

from gateway.modbus.codes import Area
from gateway.operator.operations.asked import TrendOfPoint
from gateway.operator.operations.operation import Asker
from gateway.operator.trends.told import tell_trend
from gateway.operator.units.units import picture
from gateway.operator.values.requests import AT_CONTROL
from gateway.profiles.point import Point
from gateway.web.pages.sparkline import sparklines
from gateway.web.pages.trend import number_format
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"

[[line.devices]]
unit = 1
as = 41
name = "silo/a"
points = [
    { name = "label", holding = 5, type = "string", length = 2 },
    { name = "level.1", holding = 0, scale = 0.1, decimals = 1, unit = "m" },
    { name = "mode", holding = 1 },
    { name = "alarm", coils = 3 },
]
"""
DAY = 86400.0
PAGE = "/units/silo%2Fa"


class Bench:
    def __init__(self, web, device) -> None:
        self.web = web
        self.device = device

    async def hears(self, *levels: int, every: float = 60.0) -> None:
        for level in levels:
            self.device.holding[0] = level
            await self.web.inner.client().asks(41, "03 0000 0002")
            await asyncio.sleep(every)

    async def page(self, query: str = "", path: str = PAGE) -> str:
        return (await self.web.browser().get(f"{path}{query}")).text


@asynccontextmanager
async def bench_with(tmp_path, config=CONFIG, trends=DAY):
    device = SimulatedDevice(1)
    async with web_bench(config, tmp_path, trends=trends) as web:
        web.inner.attach("hall", SimulatedLine("rtu", device))
        yield Bench(web, device)


@pytest.fixture
async def bench(tmp_path):
    async with bench_with(tmp_path) as bench:
        yield bench


def paths(page: str) -> list[str]:
    return re.findall(r'<path class="(?:band|mean)" d="([^"]*)"', page)


async def test_the_first_point_with_numbers_is_shown_over_a_day_or_over_the_first_hour(bench):
    await bench.hears(100, 200, 150)
    assert re.findall(r'data-hours="(\d+)"( aria-current)?', await bench.page())[0] == ("1", " aria-current")
    await asyncio.sleep(3600)
    page = await bench.page()
    assert 'Trend of level.1 <span class="quiet">m</span>' in page
    assert 'aria-label="level.1 from 10.0 to 20.0 m"' in page
    assert re.findall(r'data-hours="(\d+)"( aria-current)?', page)[:2] == [("1", ""), ("24", " aria-current")]
    assert ["12:00", "10.0", "15.0", "20.0"] in Markup(page).rows()
    assert "<option>label" not in page


async def test_gaps_are_gaps_and_an_hour_has_its_minutes(bench):
    await bench.hears(100, 200)
    await asyncio.sleep(180)
    await bench.hears(200)
    band, mean = paths(await bench.page("?trend=level.1&span=hour"))
    assert band == "M53 100V100h1V0h1V0h-1V100h-1zM58 0V0h1V0h-1z"
    assert mean == "M53 100V100h1V0h1M58 0V0h1"


async def test_a_point_with_labels_says_why_its_trend_is_empty(tmp_path):
    labels = CONFIG.replace("holding = 1 }", 'holding = 1, labels = { 0 = "off" } }')
    async with bench_with(tmp_path, labels) as bench:
        await bench.hears(100)
        assert "A value with a label has no trend." in await bench.page("?trend=mode")
        assert "A value with a label" not in await bench.page("?trend=alarm")


async def test_another_point_by_the_address_and_one_that_there_is_not(bench):
    await bench.hears(100)
    assert "Trend of mode" in await bench.page("?trend=mode&span=hour#trend")
    assert "Trend of level.1" in await bench.page("?trend=nothing&span=month")
    page = await bench.page("?trend=alarm")
    assert "Nothing was heard of it in this time" in page
    assert not paths(page)


async def test_a_value_that_does_not_change_is_a_line_in_the_middle(bench):
    await bench.hears(77, 77)
    band, mean = paths(await bench.page("?span=hour"))
    assert mean == "M57 50V50h1V50h1"
    assert band == "M57 50V50h1V50h1V50h-1V50h-1z"


async def test_the_page_is_as_before_where_no_trend_is_kept(tmp_path):
    async with bench_with(tmp_path, trends=0.0) as bench:
        await bench.hears(100)
        page = await bench.page()
        assert "Trend" not in page
        assert "uPlot" not in page


async def test_a_week_has_days_in_its_table(tmp_path):
    async with bench_with(tmp_path, trends=7 * DAY) as bench:
        await bench.hears(100, 300, every=1200)
        page = await bench.page("?span=week")
        assert ["05-01 12:00", "10.0", "20.0", "30.0"] in Markup(page).rows()
        assert 'data-hours="168"' in page


async def test_programs_get_it_by_names_that_need_quotes(bench):
    await bench.hears(100, 200)
    answer = (await bench.web.browser().get("/api/v1/values/silo%2Fa/level.1/history?since=1%20h&step=5%20min")).json
    assert answer == {
        "device": "silo/a",
        "point": "level.1",
        "measure": "m",
        "step_s": 300,
        "slots": [{"time": "2026-05-01T12:00:00Z", "min": 10.0, "mean": 15.0, "max": 20.0}],
    }
    assert (await bench.web.browser().get("/api/v1/values/silo%2Fa/nothing/history")).status == 404
    assert (await bench.web.browser().get("/api/v1/values/silo%2Fa/mode/history?since=soon")).status == 400


async def test_who_may_not_read_a_unit_sees_no_trend_of_it(tmp_path):
    access = '\n[[access]]\nlisten = ["web"]\nfunctions = [1]\n'
    async with bench_with(tmp_path, CONFIG + access) as bench:
        await bench.hears(100)
        page = await bench.page("?trend=mode")
        assert "Trend of alarm" in page
        assert "<option>mode" not in page
        refused = await bench.web.browser().get("/api/v1/values/41/mode/history")
        assert (refused.status, refused.json["exception"]) == (403, 1)
        operator = bench.web.operator
        assert (await tell_trend(operator, TrendOfPoint(41, "mode"), Asker(AT_CONTROL, lambda: True))).point == "mode"


async def test_sparklines_of_all_points(bench):
    await bench.hears(100, 200)
    await asyncio.sleep(120)
    await bench.hears(200)
    operator = bench.web.operator
    unit = picture(operator, 41)
    lines = await sparklines(operator)
    line = lines.of(unit, unit.points[1])
    assert (line.least, line.greatest) == ("10.0", "20.0")
    assert line.path.count("M") == 2
    assert lines.of(unit, unit.points[3]) is None


@pytest.mark.parametrize(
    ("least", "greatest", "value", "text"),
    [
        (0.0, 10.0, 3.14159, "3.14"),
        (12_345_678.9, 12_345_679.9, 12_345_679.0, "12345679"),
        (4999.66, 4999.66, 4999.66, "4999.66"),
        (0.0, 1.0, -0.0000001, "0"),
        (0.0, 65535.0, 12345.6, "12346"),
        (-1e30, 1e30, 1e30, "1000000000000000019884624838656"),
    ],
)
def test_values_have_as_many_digits_as_tell_them_apart(least, greatest, value, text):
    assert number_format(Point("level", Area.HOLDING, 0), least, greatest)(value) == text
