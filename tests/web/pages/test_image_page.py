"""The page of an image or mirror: values in a chosen type, their age, and who wrote last."""

import asyncio
import re

import pytest

from gateway.operator.images.grid import MOST
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "press" }]

[[image]]
unit = 200
name = "shift"
holding = ["0-99", "300-302", "900-1000"]
coils = 8

[[image]]
unit = 241
name = "copy"
of = "press"
stale = "3 s"
read = [{ holding = "0-3", every = "1 s" }, { coils = "0-7", every = "1 min" }]

[web]
bind = "http://127.0.0.1:8502"
"""
API = "/api/v1/images/shift/holding"


@pytest.fixture
def device():
    return SimulatedDevice(1)


@pytest.fixture
async def bench(tmp_path, device):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", device))
        await asyncio.sleep(10)
        yield bench


def grid(page: str) -> dict[int, str]:
    """The cells by their addresses."""
    return {int(at): cell for at, cell in re.findall(r'<td data-at="(\d+)"[^>]*>([^<]*)</td>', page)}


async def test_the_values_of_an_image_are_shown_by_their_addresses(bench):
    client = bench.inner.client()
    await client.asks(200, "06 00 05 00 2A")
    await client.asks(200, "0F 00 01 00 02 01 03")
    browser = bench.browser()
    cells = grid((await browser.get("/images/shift")).text)
    assert (len(cells), cells[4], cells[5]) == (103, "0", "42")
    assert grid((await browser.get("/images/200?area=coils")).text) == dict(enumerate("01100000"))


async def test_a_large_image_is_shown_in_parts(bench):
    page = (await bench.browser().get("/images/shift")).text
    following = re.search(r'<a href="([^"]*)" rel="next"', page)
    assert following is not None
    page = (await bench.browser().get("/images/shift" + following[1].replace("&amp;", "&"))).text
    assert list(grid(page)) == list(range(900, 1001))
    assert 'rel="prev"' in page
    assert 'rel="next"' not in page


async def test_values_of_two_registers_go_on_in_the_next_part_where_this_one_ends(tmp_path):
    image = '[[image]]\nunit = 200\nname = "shift"\nholding = ["1-1000"]\n'
    async with web_bench(image, tmp_path) as bench:
        shown, at = [], "?from=0&type=uint32"
        while at:
            page = (await bench.browser().get("/images/shift" + at.replace("&amp;", "&"))).text
            shown += grid(page)
            following = re.search(r'<a href="([^"]*)" rel="next"', page)
            at = following[1] if following else ""
        assert shown == list(range(1, 1000, 2))


async def test_the_parts_on_a_wall_panel_are_for_it_too(bench):
    page = (await bench.browser().get("/images/shift?kiosk")).text
    assert re.search(r'href="[^"]*&amp;kiosk" rel="next"', page)
    assert 'href="?area=coils&amp;kiosk"' in page
    assert '<input type="hidden" name="kiosk">' in page


async def test_values_have_the_type_that_is_asked_for(bench):
    await bench.inner.client().asks(200, "10 00 02 00 02 04 00 00 41 20")
    page = (await bench.browser().get("/images/shift?from=2&type=float32&swap=words")).text
    assert grid(page)[2] == "10.0"
    assert '<th scope="col" class="number">+8</th>' in page
    assert grid((await bench.browser().get("/images/shift?from=0&type=int32")).text)[2] == str(0x4120)


async def test_last_writers_are_told(bench):
    await bench.inner.client("10.0.0.7:5000").asks(200, "10 00 00 00 02 04 00 01 00 02")
    await asyncio.sleep(90)
    await bench.inner.client("10.0.0.8:6000").asks(200, "06 00 01 00 03")
    page = (await bench.browser().get("/images/shift")).text
    assert re.search(r'data-at="0"[^>]* title="10.0.0.7:5000"', page)
    assert re.search(r'data-at="1"[^>]* title="10.0.0.8:6000"', page)
    assert not re.search(r'data-at="2"[^>]* title', page)
    assert re.search(r"holding 0-1</th><td>10.0.0.7:5000</td><td>90 s ago", page)


async def test_a_refused_write_and_a_read_have_no_writer(bench):
    client = bench.inner.client()
    await client.asks(200, "06 01 00 00 03")
    await client.asks(200, "03 00 00 00 03")
    assert "None since the start." in (await bench.browser().get("/images/shift")).text


async def test_a_mirror_shows_its_values_and_their_age(bench, device):
    device.holding[:2] = [5, 6]
    await asyncio.sleep(1.5)
    page = (await bench.browser().get("/images/copy")).text
    assert grid(page) == {0: "5", 1: "6", 2: "0", 3: "0"}
    assert 'href="/units/press"' in page
    assert "values older than 3000 ms are not sent" in page
    assert page.count(">fresh<") == 1


async def test_stale_values_are_marked_and_unknown_ones_are_not_shown(bench, device):
    await bench.inner.client().asks(241, "06 00 00 00 07")
    device.silent = True
    page = (await bench.browser().get("/images/copy")).text
    assert re.search('data-at="1" class="unknown">\u2013<', page)
    device.silent = False
    await asyncio.sleep(30)
    device.silent = True
    await asyncio.sleep(8)
    page = (await bench.browser().get("/images/copy")).text
    assert re.search(r'data-at="1" class="old">0<', page)
    assert 'class="state failing">stale' in page
    values = (await bench.browser().get("/api/v1/images/copy/holding/0-3")).json["values"]
    assert {each["state"] for each in values} == {"stale"}
    assert all(each["age_ms"] > 3000 for each in values)


async def test_a_write_through_a_mirror_has_its_writer(bench):
    await bench.inner.client("10.0.0.7:5000").asks(241, "06 00 00 00 07")
    page = (await bench.browser().get("/images/copy")).text
    assert re.search(r'data-at="0"[^>]* title="10.0.0.7:5000"', page)


async def test_programs_get_the_same_without_a_request(bench):
    await bench.inner.client("10.0.0.7:5000").asks(200, "06 00 05 FF FE")
    requests = bench.inner.gateway.images[0].counts.requests
    page = await bench.browser().get(f"{API}/4-5?type=int16")
    assert page.json["values"][1] == {
        "address": 5,
        "reference": "40006",
        "value": -2,
        "registers": [65534],
        "text": "-2",
        "state": "fresh",
        "writer": "10.0.0.7:5000",
        "written_ms": 0.0,
    }
    assert page.json["stale_ms"] is None
    assert bench.inner.gateway.images[0].counts.requests == requests
    assert (await bench.browser().get(f"{API}/98-310")).json["values"][2]["address"] == 300


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (f"{API}/0-{MOST}", 400),
        (f"{API}/0-1?type=x", 400),
        ("/api/v1/images/press/holding/0", 404),
        ("/api/v1/images/nothing/holding/0", 404),
        ("/images/shift?area=x", 400),
        ("/images/shift?from=x", 400),
        ("/images/shift?swap=x", 400),
        ("/images/nothing", 404),
    ],
)
async def test_what_there_is_not_is_a_problem(bench, path, status):
    assert (await bench.browser().get(path)).status == status


async def test_a_type_of_another_area_is_forgotten(bench):
    page = await bench.browser().get("/images/shift?area=coils&type=float32&swap=words")
    assert grid(page.text) == dict(enumerate("00000000"))


async def test_a_device_is_shown_as_a_unit(bench):
    page = await bench.browser().get("/images/press")
    assert (page.status, page.headers["Location"]) == (303, "/units/press")


async def test_who_may_not_read_it_sees_no_values(tmp_path):
    rights = '[[access]]\nlisten = ["web"]\nfunctions = [1]\n'
    async with web_bench(CONFIG.partition("[web]")[0] + rights, tmp_path) as bench:
        page = (await bench.browser().get("/images/shift")).text
        assert grid(page) == {}
        assert "You may not read this." in page
        assert grid((await bench.browser().get("/images/shift?area=coils")).text) != {}
        assert (await bench.browser().get(f"{API}/0-1")).json["exception"] == 1


async def test_the_gateway_itself_has_a_page(tmp_path):
    async with web_bench('[self]\nunit = 247\n[[image]]\nunit = 200\nname = "shift"\nholding = 1\n', tmp_path) as bench:
        page = await bench.browser().get("/images/247")
        assert page.status == 200
        assert "The state of the gateway itself" in page.text
