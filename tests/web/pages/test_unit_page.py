"""The page of a unit: answer times against limits, failures with their story, values and their age."""

import asyncio
import re

import pytest

from gateway.operator.units.answer_times import FunctionTimes
from gateway.web.pages.histogram import WIDTH, plotted
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
timeout = "2 s"
points = [
    { name = "level", holding = 0, scale = 0.1, decimals = 1, unit = "m" },
    { name = "mode", holding = 1, labels = { 0 = "off", 1 = "auto" } },
    { name = "start", holding = 9, write = "only" },
    { name = "alarm", input = 3 },
]

[[line.devices]]
unit = 2
as = 42
name = "mute"
"""
MIRROR = """
[[image]]
unit = 241
name = "copy"
of = "silo/a"
stale = "3 s"
read = [{ holding = "0-1", every = "1 s" }]
"""
PAGE = "/units/silo%2Fa"


@pytest.fixture
def device():
    return SimulatedDevice(1, delay=0.02)


@pytest.fixture
async def bench(tmp_path, device):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        yield bench


@pytest.fixture
async def mirrored(tmp_path, device):
    async with web_bench(CONFIG + MIRROR, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        await asyncio.sleep(10)
        yield bench


def cells(page: str, point: str) -> list[str]:
    """What the row of a point shows, without markup."""
    row = re.search(rf'<tr data-point="{point}">(.*?)</tr>', page, re.DOTALL)
    assert row is not None
    return [re.sub(r"<[^>]+>|\s+", " ", cell).strip() for cell in re.findall(r"<td.*?>(.*?)</td>", row[1], re.DOTALL)]


async def read(bench, times: int, pdu: str = "03 00 00 00 01", unit: int = 41) -> None:
    client = bench.inner.client()
    for _ in range(times):
        await client.asks(unit, pdu)


async def test_a_unit_is_found_by_name_and_by_number(bench):
    for path in (PAGE, "/units/41"):
        page = await bench.browser().get(path)
        assert page.status == 200
        assert '<h1>Unit silo/a <span class="quiet">41</span></h1>' in page.text
        assert 'href="/lines/hall"' in page.text


async def test_the_page_of_its_line_gives_it_the_same_number_everywhere(bench):
    await read(bench, 20)
    rows = Markup((await bench.browser().get("/lines/hall")).text).rows()
    assert [cell for row in rows for cell in row if cell.startswith("silo/a")] == ["silo/a 41", "silo/a 41"]


async def test_a_unit_that_there_is_not_is_told_to_people_as_a_page(bench):
    page = await bench.browser().get("/units/nothing", Accept="text/html")
    assert page.status == 404
    assert "<h1" in page.text
    assert "nothing has the name" in page.text
    assert (await bench.browser().get("/units/nothing")).problem


async def test_nobody_without_a_login_sees_it_from_elsewhere(bench):
    page = await bench.browser("10.0.0.9").get(PAGE)
    assert page.status == 303
    assert (await bench.browser("10.0.0.9").post(f"{PAGE}/points")).status == 303


async def test_a_limit_that_is_far_too_long_is_said_to_be_and_a_better_one_proposed(bench):
    await read(bench, 150)
    page = (await bench.browser().get(PAGE)).text
    assert "The limit could be shorter" in page
    assert re.search(r"Each request without a response holds the line for 20\d\d ms\.", page)
    assert "modbus-gateway calibrate silo/a" in page
    proposed = re.search(r"proposed (\d+) ms</text>", page)
    assert proposed is not None
    assert 20 < int(proposed[1]) < 100


def proposed(page: str) -> list[int]:
    return [int(each) for each in re.findall(r"proposed (\d+) ms</text>", page)]


async def test_a_proposed_limit_is_never_below_the_slowest_response_and_waits_for_enough(bench, device):
    await read(bench, 60)
    assert not proposed((await bench.browser().get(PAGE)).text)
    device.delay = 0.3
    await read(bench, 1)
    device.delay = 0.02
    await read(bench, 100)
    (limit,) = proposed((await bench.browser().get(PAGE)).text)
    assert 300 < limit < 450


async def test_a_limit_that_responses_come_close_to_is_too_tight(bench, device):
    device.delay = 1.8
    await read(bench, 25)
    assert "The limit is too tight" in (await bench.browser().get(PAGE)).text


async def test_few_responses_say_nothing_of_a_limit(bench):
    await read(bench, 5)
    page = (await bench.browser().get(PAGE)).text
    assert "Too few responses to judge the limit" in page
    assert "proposed" not in page


async def test_what_was_never_sent_has_no_answer_times(bench):
    await read(bench, 1)
    await read(bench, 1, "05 00 00 12 34")  # refused by the gateway
    page = (await bench.browser().get(PAGE)).text
    assert "03 read holding" in page
    assert "05 write coil" not in page


async def test_the_histogram_is_also_a_table(bench):
    await read(bench, 30)
    page = (await bench.browser().get(PAGE)).text
    rows = re.findall(r'<td class="number">([\d.]+) ms</td><td class="number">([\d.]+) ms</td>', page)
    assert [(float(low) < 20, float(high) > 15) for low, high in rows] == [(True, True)]
    assert '<td class="number">30</td></tr>' in page
    assert 'role="img" aria-label="Answer times: half within' in page


async def test_failures_are_counted_by_kind_and_told(bench, device):
    device.refuses[3] = 4
    await read(bench, 1)
    device.silent = True
    await read(bench, 1, "04 00 00 00 01")
    page = (await bench.browser().get(PAGE)).text
    assert re.search(r'time-out</th><td class="number">1</td><td>No response came within the limit.', page)
    assert re.search(r'exception 04</th><td class="number">1</td>', page)
    assert "10.0.0.9:49152: read input 0 (30001)" in page
    assert re.search(r"No response came within 20\d\d ms\.", page)


async def test_who_may_not_read_a_unit_is_not_told_what_was_asked_of_it(tmp_path, device):
    rights = '[[access]]\nlisten = ["web"]\nallow = []\n[[access]]\nallow = ["read", "write"]\n'
    async with web_bench(CONFIG + rights, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        device.silent = True
        await read(bench, 1)
        page = (await bench.browser().get(PAGE)).text
        assert "No response came within the limit." in page
        assert "read holding 0 (40001)" not in page


async def test_an_open_page_asks_the_unit_for_nothing(bench, device):
    for _ in range(5):
        page = await bench.browser().get(PAGE)
        await asyncio.sleep(5)
    assert device.heard == []
    assert cells(page.text, "level")[1] == "\u2013"


async def test_points_are_read_when_somebody_wants_it_and_are_shown_with_their_age(bench, device):
    device.holding[:2] = [123, 1]
    browser = bench.browser()
    page = await browser.post(f"{PAGE}/points")
    assert (page.status, page.headers["Location"]) == (303, f"{PAGE}#points")
    await asyncio.sleep(7)
    page = (await browser.get(PAGE)).text
    assert cells(page, "level")[1:] == ["12.3", "m", "fresh", "7 s ago", "web@127.0.0.1"]
    assert cells(page, "mode")[1:4] == ["auto", "", "fresh"]
    assert cells(page, "start")[1] == "write-only"


async def test_what_a_client_has_read_is_shown_at_once_above_all_else(bench, device):
    device.holding[:2] = [123, 1]
    await read(bench, 1, "03 00 00 00 02")
    page = (await bench.browser().get(PAGE)).text
    assert cells(page, "level")[1:4] == ["12.3", "m", "fresh"]
    assert cells(page, "alarm")[1:4] == ["\u2013", "", "never"]
    headings = re.findall(r'<h2 id="(\w+)"', page)
    assert headings.index("points") < headings.index("times") < headings.index("failures")
    await asyncio.sleep(61)
    assert cells((await bench.browser().get(PAGE)).text, "level")[3] == "stale"


async def test_an_exception_is_shown_until_the_point_is_heard_again(bench, device):
    await read(bench, 1, "03 00 00 00 02")
    await asyncio.sleep(1)
    device.refuses[3] = 4
    browser = bench.browser()
    await browser.post(f"{PAGE}/points")
    assert "server device failure" in cells((await browser.get(PAGE)).text, "level")[1]
    del device.refuses[3]
    await asyncio.sleep(1)
    await read(bench, 1, "03 00 00 00 02")
    assert cells((await browser.get(PAGE)).text, "level")[1] == "0.0"


async def test_a_unit_without_points_shows_what_passed_last_and_how_to_get_some(tmp_path):
    mute = SimulatedDevice(2)
    mute.holding[7:9] = [5, 65535]
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", mute))
        page = (await bench.browser().get("/units/mute")).text
        assert "None." in page
        await read(bench, 1, "03 00 07 00 02", unit=42)
        page = (await bench.browser().get("/units/mute")).text
        assert ["holding 7-8", "5 65535"] in [row[:2] for row in Markup(page).rows()]
        assert "modbus-gateway profile list" in page
        assert "modbus-gateway import csv" in page


async def test_points_that_many_want_at_once_are_read_once(bench, device):
    await asyncio.gather(*(bench.browser().post(f"{PAGE}/points") for _ in range(20)))
    assert len(device.heard) == 2
    await asyncio.sleep(1.1)
    await bench.browser().post(f"{PAGE}/points")
    assert len(device.heard) == 4


async def test_programs_may_take_what_others_have_read(bench, device):
    browser = bench.browser()
    await browser.get("/api/v1/units/41/points")
    await asyncio.sleep(3)
    taken = await browser.get("/api/v1/units/41/points?max_age=5")
    assert len(device.heard) == 2
    assert 3000 <= taken.json["age_ms"] < 3100
    assert (await browser.get("/api/v1/units/41/points")).json["age_ms"] < 100
    assert len(device.heard) == 4
    assert (await browser.get("/api/v1/units/41/points?max_age=61")).status == 400


async def test_who_has_not_all_rights_sees_no_values_that_others_have_read(tmp_path, device):
    rights = """
[[access]]
from = ["10.0.0.0/8"]
listen = ["web"]
units = [41]
functions = [4]
[[access]]
allow = ["read", "write"]
"""
    async with web_bench(CONFIG + rights, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        device.holding[0] = 123
        await bench.browser().post(f"{PAGE}/points")
        other = bench.browser("10.0.0.9")
        await other.log_in("vera")
        assert cells((await bench.browser().get(PAGE)).text, "level")[1] == "12.3"
        assert cells((await other.get(PAGE)).text, "level")[1] == "\u2013"
        await other.post(f"{PAGE}/points")
        assert "illegal function" in cells((await other.get(PAGE)).text, "level")[1]
        assert cells((await other.get(PAGE)).text, "alarm")[1] == "0"


async def test_values_of_a_mirror_are_there_at_once_with_its_age(mirrored, device):
    device.holding[0] = 55
    await asyncio.sleep(1.5)
    heard = len(device.heard)
    page = (await mirrored.browser().get(PAGE)).text
    assert cells(page, "level")[1:4] == ["5.5", "m", "fresh"]
    assert re.fullmatch(r"[01] s ago", cells(page, "level")[4])
    assert cells(page, "level")[5] == "mirror copy"
    assert cells(page, "alarm")[1] == "\u2013"
    assert 'href="/images/copy"' in page
    assert len(device.heard) == heard


async def test_a_value_of_a_mirror_that_is_too_old_is_stale(mirrored, device):
    device.silent = True
    await asyncio.sleep(8)
    assert cells((await mirrored.browser().get(PAGE)).text, "level")[3] == "stale"


async def test_who_may_not_read_a_unit_sees_no_values_of_its_mirror_there(tmp_path, device):
    rights = '[[access]]\nlisten = ["web"]\nunits = [41]\nallow = []\n[[access]]\nallow = ["read", "write"]\n'
    async with web_bench(CONFIG + MIRROR + rights, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        await asyncio.sleep(10)
        browser = bench.browser()
        assert cells((await browser.get("/images/copy")).text, "level")[1] == "0.0"
        assert cells((await browser.get(PAGE)).text, "level")[1] == "\u2013"


async def test_values_are_read_by_area_address_type_and_swap(bench, device):
    device.holding[10:12] = [0x0000, 0x4120]
    browser = bench.browser()
    page = await browser.get(f"{PAGE}/values?area=holding&start=0x0A&count=1&type=float32&swap=words")
    assert page.status == 200
    assert re.search(r'holding 10</th><td class="quiet">40011</td><td class="number">10.0</td>', page.text)
    assert 'name="start" size="6" required value="0x0A"' in page.text
    assert (await browser.get(f"{PAGE}/values?area=coils&start=0&count=3")).text.count('<td class="number">0</td>') == 3


async def test_an_exception_is_told_where_the_values_would_be(bench):
    page = await bench.browser().get(f"{PAGE}/values?area=holding&start=500&count=2")
    assert page.status == 200
    assert "exception 02, illegal data address" in page.text


@pytest.mark.parametrize(
    "query", ["area=x", "area=holding&start=x", "area=holding&count=0", "area=holding&start=65535&count=2", "type=x"]
)
async def test_a_form_that_makes_no_sense_is_a_problem(bench, device, query):
    page = await bench.browser().get(f"{PAGE}/values?{query}", Accept="text/html")
    assert page.status == 400
    assert "That does not fit" in page.text
    assert device.heard == []


async def test_a_page_of_another_site_makes_nobody_ask_a_unit(bench, device):
    browser = bench.browser()
    page = await browser.get(f"{PAGE}/values?area=holding&start=0&count=1", Sec_Fetch_Site="cross-site")
    assert page.status == 403
    assert (await browser.post(f"{PAGE}/points", Origin="http://evil.example")).status == 403
    assert device.heard == []


def times(counts: dict[int, int], limit: float, proposed: float | None = None) -> FunctionTimes:
    bounds = (1.0, 2.0, 5.0, 10.0, 100.0, 1000.0)
    filled = tuple(counts.get(bucket, 0) for bucket in range(len(bounds) + 1))
    return FunctionTimes(3, sum(filled), 0, 0, 0.0, 0.0, bounds, filled, 1.0, 2.0, 0.1, limit, proposed, "right")


def test_the_marks_of_a_histogram_stand_right_of_shorter_times():
    plot = plotted(times({2: 5, 3: 5}, limit=1000.0, proposed=20.0))
    low, high = plot.bars
    marks = {mark.kind: mark.x for mark in plot.marks}
    assert 0 <= low.x < high.x < high.x + high.width <= marks["proposed"] < marks["limit"] < WIDTH


def test_equal_counts_have_equal_areas():
    plot = plotted(times({3: 50, 4: 50}, limit=1000.0))
    narrow, wide = ((bar.width + 1) * bar.height for bar in plot.bars)
    assert narrow == pytest.approx(wide, rel=0.02)


def test_times_beyond_the_last_bound_are_shown():
    plot = plotted(times({6: 1}, limit=500.0))
    assert plot.bars[0].to_ms is None
    assert plot.bars[0].x + plot.bars[0].width <= WIDTH


async def test_values_of_the_device_that_had_this_number_before_are_shown_no_longer(bench, device, tmp_path):
    device.holding[0] = 123
    browser = bench.browser()
    await browser.log_in("anna")
    await browser.post(f"{PAGE}/points")
    assert cells((await browser.get(PAGE)).text, "level")[1] == "12.3"
    (tmp_path / "gateway.toml").write_text(CONFIG.replace('"hall"', '"annex"').replace("/dev/hall", "/dev/annex"))
    assert (await browser.post("/api/v1/reload")).status == 200
    assert "12.3" not in (await browser.get(PAGE)).text
    other = SimulatedDevice(1)
    other.holding[0] = 45
    bench.inner.attach("annex", SimulatedLine("rtu", other))
    await asyncio.sleep(1)
    told = (await browser.get("/api/v1/units/41/points?max_age=60")).json
    assert told["values"][0]["value"] == 4.5


async def test_what_followed_a_failure_is_counted_beside_its_cause(bench, device):
    device.silent = True
    await read(bench, 1)
    await read(bench, 12)
    page = (await bench.browser().get(PAGE)).text
    stories = page.partition('<ul class="stories"')[2].partition("</ul>")[0]
    assert "No response came within" in stories
    assert re.search(r"\d+ more not sent: late response awaited", stories)
    assert "Nothing was sent" not in stories
    assert re.search(r"Each request without a valid response kept about \d+ others from being sent", page)


async def test_a_unit_leads_to_its_traffic(bench):
    assert 'href="/traffic?unit=silo/a"' in (await bench.browser().get(PAGE)).text
