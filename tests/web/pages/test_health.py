"""The page of the health: what was measured at once, what devices answer by order of an operator."""

import asyncio

import pytest

from gateway.tools.examinations import LONGEST, PAUSE
from gateway.web.pages.health import in_parts
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.markup import Markup

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "<oven>" }]

[[upstream]]
name = "plant"
to = "tcp://10.1.0.5"
units = [{ as = 37, unit = 1 }]
"""


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        await asyncio.sleep(1)
        yield bench


async def rows(browser, path="/health"):
    page = await browser.get(path)
    assert page.status == 200, page.text
    return [" | ".join(row) for row in Markup(page.text).rows()]


async def operator(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


async def test_what_was_measured_is_shown_at_once_and_nothing_is_sent_for_it(bench):
    client = bench.inner.client()
    for _ in range(4):
        await client.asks(47, "03 00 00 00 01")
    before = bench.running.ring.added
    shown = await rows(bench.browser())
    assert bench.running.ring.added == before
    assert any(row.startswith("to fix | port of hall | /dev/hall does not exist plug the adapter in") for row in shown)
    assert any(row.startswith("to fix | unit 47, <oven> | does not answer") for row in shown)
    assert "note | hall | not asked yet: 1 of 2 units" in shown


async def test_a_line_that_is_down_for_its_port_is_one_fault(bench):
    bench.inner.lines["hall"].pull("/dev/hall does not exist")
    fixes = [row for row in await rows(bench.browser()) if row.startswith("to fix")]
    assert [row.split(" | ")[1] for row in fixes] == ["port of hall"]


async def test_what_a_finding_is_about_is_named_in_the_language_of_the_page(bench):
    for _ in range(4):
        await bench.inner.client().asks(47, "03 00 00 00 01")
    about = {row.split(" | ")[1] for row in await rows(bench.browser(), "/health?lang=zh") if " | " in row}
    assert {"hall 的端口", "单元 47, <oven>"} <= about


async def test_it_is_found_out_again_after_some_seconds_only(bench):
    first = await rows(bench.browser())
    for _ in range(4):
        await bench.inner.client().asks(46, "03 00 00 00 01")
    assert await rows(bench.browser()) == first
    await asyncio.sleep(11)
    assert await rows(bench.browser()) != first


async def test_an_operator_lets_devices_be_asked_and_the_result_is_kept(bench):
    anna = await operator(bench)
    assert "Test the devices now" in (await anna.get("/health")).text
    page = await anna.post("/health")
    assert (page.status, page.headers["Location"]) == (303, "/health")
    assert "The devices are being tested" in (await bench.browser().get("/health")).text
    await asyncio.sleep(LONGEST)
    text = (await bench.browser().get("/health")).text
    assert "for anna, within" in text
    assert "doctor has sent" in text
    assert "The devices are being tested" not in text


async def test_one_at_a_time_and_not_again_at_once(bench):
    anna = await operator(bench)
    assert (await anna.post("/health")).status == 303
    page = await anna.post("/health")
    assert page.status == 409
    assert "in progress" in page.text
    await asyncio.sleep(40)
    page = await anna.post("/health")
    assert page.status == 409
    assert "try again in" in page.text
    await asyncio.sleep(PAUSE)
    assert (await anna.post("/health")).status == 303


async def test_not_while_doctor_runs_at_the_control_socket(bench):
    anna = await operator(bench)
    async with bench.running.examining:
        assert (await anna.post("/health")).status == 409
    assert (await anna.post("/health")).status == 303


async def test_an_examination_that_takes_too_long_is_ended(bench, monkeypatch):
    async def for_ever(*_, asks, **__):
        if asks:
            await asyncio.sleep(10 * LONGEST)
        return [], []

    monkeypatch.setattr("gateway.tools.examinations.examined", for_ever)
    anna = await operator(bench)
    await anna.post("/health")
    await asyncio.sleep(LONGEST + 1)
    assert "took longer than 120 s" in (await anna.get("/health")).text
    assert not bench.running.examining.locked()


async def test_a_defect_ends_the_examination_and_is_logged(bench, monkeypatch):
    async def broken(*_, asks, **__):
        if asks:
            raise ZeroDivisionError
        return [], []

    monkeypatch.setattr("gateway.tools.examinations.examined", broken)
    anna = await operator(bench)
    await anna.post("/health")
    await asyncio.sleep(1)
    assert (await anna.get("/health")).status == 200
    assert [event.part for event in bench.events("part_failed")] == ["doctor"]


@pytest.mark.parametrize("user", ["", "vera"])
async def test_nobody_else_can_order_it(bench, user):
    browser = bench.browser()
    if user:
        await browser.log_in(user)
    assert "Test the devices now" not in (await browser.get("/health")).text
    assert (await browser.post("/health")).status == (403 if user else 401)
    assert "The devices are being tested" not in (await browser.get("/health")).text


async def test_it_needs_the_token_of_the_session(bench):
    anna = await operator(bench)
    assert (await anna.post("/health", X_CSRF_Token="forged")).status == 403


async def test_nothing_of_the_config_becomes_markup(bench):
    client = bench.inner.client()
    for _ in range(4):
        await client.asks(47, "03 00 00 00 01")
    assert "<oven>" not in (await bench.browser().get("/health")).text


@pytest.mark.parametrize(
    ("remedy", "typed"),
    [
        ("disconnect one of them and give it another address", []),
        ("systemctl disable --now gpsd.socket gpsd.service", ["systemctl disable --now gpsd.socket gpsd.service"]),
        ("end it: kill 4711", ["kill 4711"]),
        ("echo 1 > /sys/class/tty/x/latency_timer, or install the rules", ["echo 1 > /sys/class/tty/x/latency_timer"]),
        ("gateway.toml:12: unit = 3, or set the address at the device", ["unit = 3"]),
        ('connect it to a line of its own with role = "server"', ['role = "server"']),
        ("modbus-gateway profile shows what each kind of device accepts", ["modbus-gateway profile"]),
        ("let clients ask less often, or let them read an [[image]]", ["[[image]]"]),
    ],
)
def test_only_what_is_to_be_typed_is_in_the_font_of_commands(remedy, typed):
    parts = in_parts(remedy)
    assert "".join(text for text, _ in parts) == remedy
    assert [text for text, is_typed in parts if is_typed] == typed
