"""The page of all values, and its CSV: what is known of all points, searched, by device, for those who may read it."""

import asyncio
import csv
import re
from io import StringIO
from urllib.parse import quote
from zlib import crc32

import pytest

from gateway.web.pages.sparkline import Sparkline
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[profile.meter]
points = [
    { name = "power", holding = 0, unit = "kW", scale = 0.1, decimals = 1 },
    { name = "state", holding = 1, labels = { 1 = "läuft" } },
    { name = "energy.total", holding = 2, unit = "kWh", invalid = 0xFFFF },
    { name = "flow", input = 5, unit = "m³/h" },
    { name = "reset", holding = 9, write = "only" },
]

[[line]]
name = "hall"
port = "/dev/hall"
devices = [
    { unit = 1, as = 41, name = "boiler/a & b", profile = "meter" },
    { unit = 2, as = "none", name = "Pumpe", profile = "meter" },
    { unit = 3, as = 43, name = "mute" },
]
"""
#: As many points as no page shows at once.
MANY = """
[[line]]
name = "hall"
port = "/dev/hall"
""" + "".join(
    f'[[line.devices]]\nunit = {unit}\nname = "meter-{unit}"\n'
    f'points = [{{ name = "u*", holding = "0-119", unit = "V" }}]\n'
    for unit in range(1, 11)
)


@pytest.fixture
def boiler():
    device = SimulatedDevice(1)
    device.holding[:3] = [123, 1, 0xFFFF]
    return device


@pytest.fixture
async def bench(tmp_path, boiler):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", boiler, SimulatedDevice(2)))
        await bench.inner.client().asks(41, "03 00 00 00 03")
        yield bench


@pytest.fixture
async def many(tmp_path):
    async with web_bench(MANY, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", *(SimulatedDevice(unit) for unit in range(1, 11))))
        yield bench


async def shown(browser, query: str = "") -> dict[str, dict[str, list[str]]]:
    """The rows of each device that is open; of one that is folded, nothing."""
    found: dict[str, dict[str, list[str]]] = {}
    page = (await browser.get(f"/values{query}")).text
    for device, content in re.findall(r'<details [^>]*data-device="([^"]*)"[^>]*>(.*?)</details>', page, re.DOTALL):
        rows = Markup(content).rows()
        found[device] = {name: cells for name, *cells, _trend in rows}
    return found


async def found(browser, search: str) -> dict[str, list[str]]:
    """The names of the points that are found, by device."""
    return {device: [*rows] for device, rows in (await shown(browser, f"?search={quote(search)}")).items()}


def sign(unit: int) -> str:
    """What a device is called in addresses."""
    return f"{crc32(f'meter-{unit}'.encode()):x}"


async def test_each_point_has_its_value_unit_state_age_and_source(bench, boiler):
    heard = len(boiler.heard)
    await asyncio.sleep(3)
    everything = await shown(bench.browser())
    assert everything["boiler/a &amp; b"] == {
        "power": ["12.3", "kW", "fresh", "3 s ago", "10.0.0.9:49152"],
        "state": ["läuft", "", "fresh", "3 s ago", "10.0.0.9:49152"],
        "energy.total": ["–", "kWh", "invalid", "3 s ago", "10.0.0.9:49152"],  # noqa: RUF001
        "flow": ["–", "m³/h", "never", "", ""],  # noqa: RUF001
    }
    assert {state for _, _, state, *_ in everything["Pumpe"].values()} == {"never"}
    assert "mute" not in everything
    assert len(boiler.heard) == heard
    await asyncio.sleep(60)
    assert (await shown(bench.browser()))["boiler/a &amp; b"]["power"][2] == "stale"


async def test_a_point_with_a_trend_has_a_small_line(bench, monkeypatch):
    class Sparklines:
        def of(self, unit, point):
            return Sparkline("M0 8h.5L1 8", "12.1", "12.9") if (unit.unit, point.name) == (41, "power") else None

    async def sparklines(_operator):
        return Sparklines()

    assert "<path d=" not in (await bench.browser().get("/values")).text.partition("<main")[2]
    monkeypatch.setattr("gateway.web.pages.values.sparklines", sparklines)
    page = (await bench.browser().get("/values?search=boiler")).text
    assert page.count('<path d="M0 8h.5L1 8"/>') == 1
    assert 'aria-label="from 12.1 to 12.9 lately"' in page


async def test_a_point_leads_to_its_trend_on_the_page_of_its_unit(bench):
    page = (await bench.browser().get("/values")).text
    assert 'href="/units/boiler%2Fa%20%26%20b?trend=energy.total#trend"' in page
    assert (await bench.browser().get("/units/boiler%2Fa%20%26%20b?trend=energy.total")).status == 200
    assert (await bench.browser().get("/units/Pumpe?trend=power")).status == 200


@pytest.mark.parametrize(
    ("search", "expected"),
    [
        ("POWER", {"boiler/a &amp; b": ["power"], "Pumpe": ["power"]}),
        ("kwh pumpe", {"Pumpe": ["energy.total"]}),
        ("m³", {"boiler/a &amp; b": ["flow"], "Pumpe": ["flow"]}),
        ("a & b st", {"boiler/a &amp; b": ["state"]}),
        ("nothing", {}),
        ('"><script>', {}),
    ],
)
async def test_a_search_finds_points_devices_and_units_of_measure(bench, search, expected):
    assert await found(bench.browser(), search) == expected
    page = (await bench.browser().get(f"/values?search={quote(search)}")).text
    assert "<script>" not in page


async def test_a_state_can_be_chosen(bench):
    browser = bench.browser()
    assert await shown(browser, "?state=invalid") == {
        "boiler/a &amp; b": {"energy.total": ["–", "kWh", "invalid", "0 s ago", "10.0.0.9:49152"]}  # noqa: RUF001
    }
    assert [*(await shown(browser, "?state=fresh"))["boiler/a &amp; b"]] == ["power", "state"]
    assert (await browser.get("/values?state=rotten")).status == 200


async def test_who_may_not_read_a_point_does_not_find_it(tmp_path, boiler):
    rights = '[[access]]\nlisten = ["web"]\nunits = 41\nfunctions = [4]\n'
    async with web_bench(CONFIG + rights, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", boiler))
        browser = bench.browser()
        assert await found(browser, "") == {"boiler/a &amp; b": ["flow"]}
        assert "power" not in (await browser.get("/values.csv")).text
        assert (await bench.browser("10.0.0.9").get("/values")).status == 303
        assert (await bench.browser("10.0.0.9").get("/values.csv")).status == 303


async def test_of_many_points_devices_are_folded_until_they_are_opened(many):
    browser = many.browser()
    page = (await browser.get("/values")).text
    assert "1200 points" in page
    assert page.count("<tr data-point") == 120
    assert page.count("120 never") == 10
    assert f'href="/values?open={sign(1)},{sign(2)}#device-{sign(2)}"' in page
    opened = await shown(browser, f"?open={sign(2)}")
    assert [device for device, rows in opened.items() if rows] == ["meter-2"]
    assert len(opened["meter-2"]) == 120
    page = (await browser.get(f"/values?search=u&open={sign(2)}")).text
    assert f'href="/values?search=u&amp;open={sign(2)},{sign(3)}#device-{sign(3)}"' in page
    assert sum(map(len, (await shown(browser, "?search=u7")).values())) == 110
    for nothing in ("", "x", "-1,99,2.5", "," * 1000):
        assert sum(map(len, (await shown(browser, f"?search=u7&open={nothing}")).values())) == 0
    page = (await browser.get(f"/values?open={','.join(map(sign, range(1, 11)))}")).text
    assert page.count("<tr data-point") == 1000
    assert "and 120 more" in page


async def test_the_csv_has_what_was_searched_with_points_and_times_in_one_form(bench):
    page = await bench.browser().get("/values.csv?search=boiler&lang=zh")
    assert page.headers["Content-Type"] == "text/csv; charset=utf-8"
    assert page.text.startswith("\ufeffdevice,point,value,unit,state,age,source,time\n")
    rows = list(csv.DictReader(StringIO(page.text.removeprefix("\ufeff"))))
    assert [(each["device"], each["point"]) for each in rows] == [
        ("boiler/a & b", name) for name in ("power", "state", "energy.total", "flow")
    ]
    power, _, energy, flow = rows
    assert (power["value"], power["unit"], power["state"], power["age"]) == ("12.3", "kW", "fresh", "0.0")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", power["time"])
    assert (energy["value"], energy["state"]) == ("", "invalid")
    assert (flow["value"], flow["age"], flow["time"], flow["source"]) == ("", "", "", "")


async def test_without_any_point_the_page_says_how_to_get_some(tmp_path):
    config = '[[line]]\nname = "hall"\nport = "/dev/hall"\ndevices = [{ unit = 3, name = "mute" }]\n'
    async with web_bench(config, tmp_path) as bench:
        page = (await bench.browser().get("/values")).text
        assert "modbus-gateway profile list" in page
        assert "modbus-gateway import csv" in page


async def test_it_is_in_chinese_too(bench):
    page = (await bench.browser().get("/values?lang=zh")).text
    for word in ("有效", "无效", "从未", "数值", "搜索"):
        assert word in page
