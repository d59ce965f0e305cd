"""The history of units and lines over HTTP, and on the pages that show it."""

import asyncio
import hashlib
import re
import zlib
from datetime import UTC, datetime
from pathlib import Path

import pytest

import gateway.web
from gateway.timing.history import STEP, UNIT_SLOTS, LineUse, UnitUse
from gateway.web.pages.overview import ALL_SHOWN
from kit.browser import CLOCK, web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall & co"
port = "/dev/hall"
timeout = "200 ms"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 2, as = 42, name = "press/2" }]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]

[[image]]
unit = 200
name = "shift"
holding = 1
"""
MANY = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = "1-240", name = "unit-*" }]
"""
LINE = LineUse(600.0, 150.0, 60.0, 60, 3)
USE = UnitUse(60, 3, 1, 2, 4, 50, 1.0, 5.0, 30.0)


def begin(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        for back in (0, 1, 3):
            bench.history.add(CLOCK - back * STEP, {"hall & co": LINE}, {"silo": USE} if back < 3 else {})
        yield bench


async def test_a_line_by_slots(bench):
    told = (await bench.browser().get("/api/v1/lines/hall%20%26%20co/history?hours=1")).json
    assert (told["line"], told["step_s"]) == ("hall & co", STEP)
    assert [each["time"] for each in told["slots"]] == [*map(begin, (CLOCK - 3 * STEP, CLOCK - STEP, CLOCK))]
    assert told["slots"][2] == {
        "time": begin(CLOCK),
        "seconds": 600.0,
        "busy_share": 0.25,
        "down_s": 60.0,
        "sent": 60,
        "failed": 3,
    }


@pytest.mark.parametrize("unit", ["41", "silo"])
async def test_a_unit_by_slots(bench, unit):
    told = (await bench.browser().get(f"/api/v1/units/{unit}/history")).json
    assert (told["unit"], told["line"], told["step_s"]) == ("silo", "hall & co", STEP)
    idle, _, last = told["slots"]
    assert last == {
        "time": begin(CLOCK),
        "requests": 60,
        "timeouts": 3,
        "failed": 1,
        "not_sent": 2,
        "exceptions": 4,
        "answer_ms": 20.0,
        "limit_share": 0.1,
        "resting_s": 30.0,
    }
    assert (idle["time"], idle["requests"], idle["answer_ms"]) == (begin(CLOCK - 3 * STEP), 0, None)


async def test_a_unit_that_did_nothing_has_slots_of_nothing(bench):
    told = (await bench.browser().get("/api/v1/units/press%2F2/history")).json
    assert [each["requests"] for each in told["slots"]] == [0, 0, 0]
    assert (await bench.browser().get("/api/v1/units/37/history")).json["slots"] == []


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("lines/hall%20%26%20co/history?hours=168", 200),
        ("lines/hall%20%26%20co/history?hours=169", 400),
        ("lines/hall%20%26%20co/history?hours=0", 400),
        ("lines/hall%20%26%20co/history?hours=-1", 400),
        ("lines/hall%20%26%20co/history?hours=x", 400),
        ("lines/hall%20%26%20co/history?days=1", 400),
        ("lines/plant/history", 200),
        ("lines/nothing/history", 404),
        ("units/41/history?hours=24", 200),
        ("units/41/history?hours=25", 400),
        ("units/nobody/history", 404),
        ("units/200/history", 404),
    ],
)
async def test_what_can_be_asked_for(bench, path, status):
    assert (await bench.browser().get(f"/api/v1/{path}")).status == status


async def test_others_need_a_login(bench):
    assert (await bench.browser("10.0.0.9").get("/api/v1/units/41/history")).status == 401


async def test_the_overview_shows_each_unit_in_a_picture_and_in_words(bench):
    text = (await bench.browser().get("/")).text
    picture = re.search(
        r'<svg class="map"[^>]*aria-label="silo in the last 24 hours: 120 requests, 12 without.*?</svg>', text
    )
    end = UNIT_SLOTS
    assert f'd="M{end - 2} 12v-10h2v10z"' in picture[0]
    assert f'd="M{end - 4} 12v-1h1v1z"' in picture[0]
    assert "10 % <small" in text
    assert 'href="/units/press%2F2"' in text
    assert 'href="/lines/hall%20%26%20co"' in text


async def test_what_is_wrong_comes_first(bench):
    bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    page = (await bench.browser().get("/")).text
    assert "silo</a>" in page.partition("</section>")[0]
    assert "10 % of 120 requests without an answer in the last minutes" in page
    client = bench.inner.client()
    for _ in range(3):
        await client.asks(42, "03 0000 0001")
    await asyncio.sleep(1)
    page = (await bench.browser().get("/")).text
    state, unit = '<span class="state failing">failing</span>', '<span><a href="/units/press%2F2">press/2</a></span>'
    assert f'<li>{state} {unit} <span class="quiet">hall &amp; co</span> <span>' in page
    assert "All lines are up" not in page


async def test_a_line_that_is_down_is_told_and_its_units_are_not(bench):
    bench.inner.lines["hall"].pull("unplugged")
    client = bench.inner.client()
    await client.asks(41, "03 0000 0001")
    page = (await bench.browser().get("/?lang=en")).text
    assert '<span class="state down">down</span> <span><a href="/lines/hall%20%26%20co">' in page
    assert "unplugged</span> · tried again every second" in page
    assert '<li><span class="state failing">' not in page


async def test_the_page_of_a_line_has_its_units_and_its_hours(bench):
    text = (await bench.browser().get("/lines/hall%20%26%20co")).text
    assert "silo in the last 24 hours: 120 requests" in text
    assert 'aria-label="busy share of hall &amp; co in the last 24 hours"' in text
    assert re.search(r'<td class="number">25 %</td><td class="number">\d+</td>', text)
    assert 'href="/units/37"' not in text
    assert "uPlot" in text
    assert "uPlot" not in (await bench.browser().get("/")).text


@pytest.mark.parametrize("asked", [0, 3])
async def test_of_many_units_those_that_nobody_asks_are_counted_only(tmp_path, asked):
    assert ALL_SHOWN < 240
    async with web_bench(MANY, tmp_path) as bench:
        bench.history.add(CLOCK, {"hall": LINE}, {f"unit-{number}": USE for number in range(1, asked + 1)})
        text = (await bench.browser().get("/")).text
        assert text.count("data-unit=") == asked
        assert f"{240 - asked} more units were not asked" in text


async def test_a_page_of_240_units_is_small_on_the_way(tmp_path):
    async with web_bench(MANY, tmp_path) as bench:
        kinds = [USE, UnitUse(60, responses=60, share=6.0), UnitUse(60, 60), UnitUse(60, exceptions=30), UnitUse()]
        for back in range(UNIT_SLOTS):
            units = {f"unit-{number}": kinds[(back * number // 7) % 5] for number in range(1, 241)}
            bench.history.add(CLOCK - (UNIT_SLOTS - 1 - back) * STEP, {"hall": LINE}, units)
        wire = bench.browser().open("/", headers={"Accept-Encoding": "gzip", "Connection": "close"})
        await wire.closed.wait()
        head, _, body = bytes(wire.received).partition(b"\r\n\r\n")
        assert b"Content-Encoding: gzip" in head
        assert len(body) < 100_000
        assert zlib.decompress(body, 31).count(b"data-unit=") == 240


VENDOR = Path(gateway.web.__file__).parent / "pages" / "static" / "vendor"


def test_what_others_have_written_is_as_they_have_published_it():
    for folder in VENDOR.iterdir():
        sums = dict(reversed(line.split("  ")) for line in (folder / "SHA256SUMS").read_text().splitlines())
        files = {file.name for file in folder.iterdir()} - {"SHA256SUMS", "VERSION"}
        assert "LICENSE" in files
        assert {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in files} == sums


def test_the_version_is_that_of_the_file():
    version = (VENDOR / "uplot" / "VERSION").read_text().split()[1].rstrip(",")
    assert f"(v{version})" in (VENDOR / "uplot" / "uPlot.iife.min.js").read_text()[:80]
