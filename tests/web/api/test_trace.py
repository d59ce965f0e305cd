"""The trace over HTTP: a stream of what happens, and a capture file. In virtual time, without sockets."""

import asyncio
import json
import re
from struct import unpack_from

import pytest

from gateway.operator.operations.asked import Traced
from gateway.operator.trace.reader import capture
from gateway.operator.values.requests import AwaitedOrigin
from gateway.request import Request
from gateway.routing.access import NOTHING, AccessRow
from gateway.routing.rights import Rights
from gateway.trace.records import Answered, PortChanged
from gateway.web.front.downloads import MOST_DOWNLOADS
from gateway.web.front.streams import WRITE_TIME
from kit.asking import ask
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import PATIENCE

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press" }, { unit = 7, as = 47, name = "oven" }]

[[line]]
name = "yard"
port = "/dev/yard"
devices = [{ unit = 6, as = 48, name = "gate" }]

[[image]]
unit = 200
holding = 10
"""
LIMITED = """
[[access]]
listen = ["web"]
units = [46]
allow = ["read"]
[[access]]
listen = ["web"]
units = [47]
functions = [1]
[[access]]
listen = ["control"]
allow = ["read", "write"]
"""
TRACE, CAPTURE = "/api/v1/trace", "/api/v1/trace.pcapng"


@pytest.fixture
async def bench(tmp_path):
    async with bench_of(CONFIG, tmp_path) as bench:
        yield bench


def bench_of(config, folder):
    return web_bench(config, folder)


async def attach(bench):
    for name in ("hall", "yard"):
        bench.inner.attach(name, SimulatedLine("rtu", SimulatedDevice(6), SimulatedDevice(7)))
    await asyncio.sleep(0.1)


@pytest.fixture
async def asked(bench):
    """After a read of two units on two lines, and of an image."""
    await attach(bench)
    for unit in (46, 47, 48, 200):
        await bench.browser().get(f"/api/v1/units/{unit}/holding/0-1")
    return bench


def told(wire) -> list[dict]:
    """The facts that came, without ports and the time."""
    text = wire.received.decode()
    facts = [json.loads(line.partition("data: ")[2]) for line in text.splitlines() if line.startswith("data: ")]
    return [fact for fact in facts if fact["kind"] not in ("clock", "port")]


async def read(bench, query="", host="127.0.0.1"):
    wire = bench.browser(host).open(TRACE + query)
    await asyncio.sleep(1)
    wire.close()
    return told(wire)


async def test_what_happens_is_told_as_it_happens(bench):
    await attach(bench)
    wire = bench.browser().open(TRACE)
    await asyncio.sleep(1)
    assert told(wire) == []
    await bench.browser().get("/api/v1/units/46/holding/0-1")
    await asyncio.sleep(0.2)
    (fact,) = told(wire)
    assert (fact["kind"], fact["line"], fact["unit"], fact["name"]) == ("exchange", "hall", 46, "press")
    assert (fact["request"], fact["response"]) == ("03 00 00 00 02", "03 04 00 00 00 00")
    wire.close()


async def test_a_reader_may_begin_some_seconds_before(asked):
    assert [fact["unit"] for fact in await read(asked, "?seconds=60")] == [46, 47, 48, 200]
    assert await read(asked) == []


async def test_a_line_and_a_unit_are_chosen_by_number_or_name(asked):
    assert [fact["unit"] for fact in await read(asked, "?seconds=60&line=hall")] == [46, 47]
    assert [fact["unit"] for fact in await read(asked, "?seconds=60&unit=48")] == [48]
    assert [fact["unit"] for fact in await read(asked, "?seconds=60&unit=oven")] == [47]


async def test_function_client_and_result_choose_among_the_records(asked):
    await asked.browser().get("/api/v1/units/46/input/0-1")
    assert [fact["unit"] for fact in await read(asked, "?seconds=60&function=4")] == [46]
    assert len(await read(asked, "?seconds=60&client=127.0.0.1")) == 5
    assert await read(asked, "?seconds=60&client=10.0.0.1") == []
    assert await read(asked, "?seconds=60&result=failed") == []
    assert len(packets(await download(asked, f"{CAPTURE}?seconds=60&function=4&result=ok"))) == 2


async def test_a_sample_has_so_many_a_second_and_the_time_tells_how_many_more_there_were(bench):
    ring, now = bench.running.ring, asyncio.get_running_loop().time
    wire = bench.browser().open(f"{TRACE}?per_second=10")
    await asyncio.sleep(1)
    for _ in range(10):
        for _ in range(30):
            ring.answer(Request(200, bytes.fromhex("0300000001"), AwaitedOrigin(lambda: True), now()), b"", now(), "")
        await asyncio.sleep(0.1)
    await asyncio.sleep(2)
    assert 10 <= len(told(wire)) <= 20
    assert len(told(wire)) + sum(map(int, re.findall(rb'"left_out": (\d+)', wire.received))) == 300
    wire.close()


async def test_the_time_is_told_each_second(bench):
    wire = bench.browser().open(TRACE)
    await asyncio.sleep(5.5)
    assert 5 <= wire.received.count(b'"kind": "clock"') <= 6
    wire.close()


@pytest.mark.parametrize(
    ("query", "status"),
    [
        ("?line=nothing", 404),
        ("?unit=nobody", 404),
        ("?seconds=3601", 400),
        ("?seconds=-1", 400),
        ("?seconds=1.5", 400),
        ("?second=1", 400),
        ("?function=0", 400),
        ("?function=x", 400),
        ("?result=good", 404),
    ],
)
@pytest.mark.parametrize("path", [TRACE, CAPTURE])
async def test_what_makes_no_sense_is_refused(bench, path, query, status):
    page = await bench.browser().get(path + query)
    assert page.status == status
    assert page.problem


async def test_a_file_is_no_sample(bench):
    page = await bench.browser().get(f"{CAPTURE}?per_second=5")
    assert page.status == 400
    assert "per_second: there are only line, unit" in page.problem


@pytest.mark.parametrize("path", [TRACE, CAPTURE])
async def test_without_a_ring_it_is_said_how_to_have_one(tmp_path, path):
    async with bench_of(CONFIG + '[trace]\nring = "0"\n', tmp_path) as bench:
        page = await bench.browser().get(path)
        assert page.status == 404
        assert "ring" in page.problem


@pytest.mark.parametrize("path", [TRACE, CAPTURE])
async def test_whoever_may_not_read_sees_nothing(asked, path):
    browser = asked.browser("10.2.0.7")
    assert (await browser.get(path)).status == 401
    await browser.log_in("vera")
    wire = browser.open(f"{path}?seconds=60")
    await asyncio.sleep(1)
    assert b"200 OK" in wire.received
    assert b"hall" in wire.received
    wire.close()


@pytest.mark.parametrize("path", [TRACE, CAPTURE])
async def test_pages_of_other_sites_get_nothing(asked, path):
    assert (await asked.browser().get(path, Sec_Fetch_Site="cross-site")).status == 403


async def test_values_are_told_of_what_the_reader_may_read_only(tmp_path):
    async with bench_of(CONFIG + LIMITED, tmp_path) as bench:
        await attach(bench)
        for unit in (46, 47, 48):
            await ask(bench.running, "request", unit=unit, pdu="03 0000 0001")
        await ask(bench.running, "request", unit=46, pdu="06 0000 0007")
        facts = await read(bench, "?seconds=60")
        assert [(fact["unit"], fact["request"] is not None) for fact in facts] == [
            (46, True),
            (47, False),
            (48, False),
            (46, True),
        ]
        assert all(fact["response"] is None and fact["elapsed_ms"] > 0 for fact in facts[1:3])
        assert len(packets(await download(bench, f"{CAPTURE}?seconds=60"))) == 4


async def test_a_reader_that_does_not_read_is_dropped(bench):
    await attach(bench)
    wire = bench.browser().open(TRACE, room=1000)
    await asyncio.sleep(1)
    for number in range(300):
        bench.running.ring.add(PortChanged(asyncio.get_running_loop().time(), "hall", f"{number:1000}"))
    await asyncio.sleep(1)
    assert not wire.closed.is_set()
    await asyncio.sleep(WRITE_TIME)
    assert wire.closed.is_set()


async def test_a_reader_is_told_what_it_has_missed(bench):
    wire = bench.browser().open(TRACE)
    await asyncio.sleep(1)
    ring = bench.running.ring
    for _ in range(40_000):
        ring.add(PortChanged(asyncio.get_running_loop().time(), "hall", ""))
    before = ring.first
    await asyncio.sleep(0.2)
    assert b'"kind": "missed"' in wire.received
    assert before > 0
    wire.close()


async def test_a_stream_ends_when_its_line_is_gone(bench, tmp_path):
    anna = bench.browser()
    await anna.log_in("anna")
    wire = bench.browser().open(f"{TRACE}?line=yard")
    await asyncio.sleep(1)
    (tmp_path / "gateway.toml").write_text(CONFIG.replace('"yard"', '"road"'))
    assert (await anna.post("/api/v1/reload")).status == 200
    await asyncio.sleep(1)
    assert wire.closed.is_set()


async def test_a_capture_file_has_the_frames_of_the_last_seconds(asked):
    page = await download(asked, f"{CAPTURE}?seconds=60")
    assert b"application/x-pcapng" in page
    assert b"attachment" in page
    assert len(packets(page)) == 6
    assert len(packets(await download(asked, f"{CAPTURE}?seconds=60&line=hall"))) == 4
    await asyncio.sleep(10)
    assert packets(await download(asked, f"{CAPTURE}?seconds=5")) == []


async def test_a_capture_file_has_all_records_however_many_there_are(asked):
    ring, now = asked.running.ring, asyncio.get_running_loop().time
    for _ in range(1000):
        ring.add(PortChanged(now(), "hall", ""))
    await asked.browser().get("/api/v1/units/46/holding/0-1")
    assert len(packets(await download(asked, f"{CAPTURE}?seconds=60"))) == 8


async def test_a_file_has_nothing_more_from_when_the_right_was_taken_away(asked):
    ring, now = asked.running.ring, asyncio.get_running_loop().time
    for _ in range(1000):
        ring.add(PortChanged(now(), "hall", ""))
    await asked.browser().get("/api/v1/units/46/holding/0-1")
    web = asked.running.routers.web
    parts = capture(asked.running, Traced(since=60), "127.0.0.1")
    first = b"\r\n\r\n" + await anext(parts) + await anext(parts)
    web.rights = Rights([AccessRow(NOTHING, listeners=frozenset({"web"}))], web.entry)
    whole = first + b"".join([part async for part in parts])
    assert (len(packets(first)), len(packets(whole))) == (6, 6)


async def test_who_does_not_read_a_file_is_dropped_and_leaves_its_place(asked):
    now = asyncio.get_running_loop().time()
    for _ in range(1000):
        record = Answered(now, "hall", "", "", 46, bytes.fromhex("0300000070"), bytes((3, 224)) + bytes(224), now)
        asked.running.ring.add(record)
    wires = [asked.browser().open(CAPTURE, room=100) for _ in range(MOST_DOWNLOADS)]
    await asyncio.sleep(1)
    assert (await asked.browser().get(CAPTURE)).status == 503
    await asyncio.sleep(WRITE_TIME)
    assert all(wire.closed.is_set() for wire in wires)
    assert (await download(asked, CAPTURE)).count(b"200 OK") == 1


async def download(bench, path: str) -> bytes:
    wire = bench.browser().open(path, headers={"Connection": "close"})
    async with asyncio.timeout(PATIENCE):
        await wire.closed.wait()
    return bytes(wire.received)


def packets(page: bytes) -> list[bytes]:
    """The packets of a capture file in a response, which is not chunked if its connection closes."""
    head, _, file = page.partition(b"\r\n\r\n")
    if b"chunked" in head:
        file = unchunked(file)
    found, at = [], 0
    while at < len(file):
        kind, size = unpack_from("<II", file, at)
        if kind == 6:
            found.append(file[at : at + size])
        at += size
    return found


def unchunked(data: bytes) -> bytes:
    whole = b""
    while data:
        size, _, data = data.partition(b"\r\n")
        whole += data[: int(size, 16)]
        data = data[int(size, 16) + 2 :]
    return whole
