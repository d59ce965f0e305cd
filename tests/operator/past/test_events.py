"""The operation `events`: which are told, to whom, and what is new since an answer."""

import asyncio

import pytest

from gateway import events
from kit.browser import web_bench

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 7, as = 47, name = "press" }]

[[image]]
unit = 200
name = "shift"
holding = 10
"""
LIMITED = """
[[access]]
listen = ["web"]
from = ["10.2.0.7"]
allow = ["read"]
[[access]]
listen = ["web"]
units = "200"
allow = ["read"]
"""
HEARD = "07 03 04 DE AD BE EF 00 00"
BAD = events.BadFrame("hall", 7, "press", 3, 1.0, 2.0, "", HEARD, "wrong CRC")
AUDIT = events.WriteAudit("10.2.0.7:5000", "scada", 200, 6, 1, 1, "ok", "", 4.0)
PATH = "/api/v1/events/last"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        await asyncio.sleep(1)
        yield bench


async def last(bench, query: str = ""):
    page = await bench.browser().get(f"{PATH}{query}")
    assert page.status == 200, page.text
    return page.json


async def test_an_event_is_told_as_followers_are_told_and_in_words(bench):
    bench.fan_out.emit(AUDIT)
    told = (await last(bench))["events"][-1]
    assert {name: told[name] for name in ("event", "level", "unit", "address", "result", "times")} == {
        "event": "write_audit",
        "level": "info",
        "unit": 200,
        "address": 1,
        "result": "ok",
        "times": 1,
    }
    assert told["text"] == "10.2.0.7:5000 wrote to unit 200, address 1, count 1 with function 6: ok"
    assert told["timestamp"] == told["since"]
    assert told["timestamp"].startswith("2026-05-01T12:00:0")


async def test_what_is_new_is_what_came_after_an_answer(bench):
    bench.fan_out.emit(AUDIT)
    answer = await last(bench)
    assert await last(bench, f"?after={answer['next']}") == {"events": [], "next": answer["next"]}
    bench.fan_out.emit(BAD)
    news = await last(bench, f"?after={answer['next']}")
    assert [each["event"] for each in news["events"]] == ["bad_frame"]
    for _ in range(10):
        bench.fan_out.emit(BAD)
    (counted,) = [each for each in (await last(bench, f"?after={news['next']}"))["events"] if each["times"] > 1]
    assert counted["times"] == 7


async def test_to_a_number_from_before_a_restart_all_events_are_new(bench):
    bench.fan_out.emit(BAD)
    assert [each["event"] for each in (await last(bench, "?after=1000"))["events"]] == ["bad_frame"]


async def test_the_last_ones_and_those_of_a_time(bench):
    for number in range(10):
        bench.fan_out.emit(events.ConfigWarning(f"problem {number}", ""))
        await asyncio.sleep(10)
    assert [each["problem"] for each in (await last(bench, "?count=2"))["events"]] == ["problem 8", "problem 9"]
    assert [each["problem"] for each in (await last(bench, "?since=25"))["events"]] == ["problem 8", "problem 9"]
    assert [each["problem"] for each in (await last(bench, "?since=45&count=1"))["events"]] == ["problem 9"]


@pytest.mark.parametrize("query", ["line=nowhere", "unit=nobody", "level=debug", "since=-1", "count=0", "other=1"])
async def test_what_there_is_not_is_refused(bench, query):
    assert (await bench.browser().get(f"{PATH}?{query}")).status in (400, 404)


async def test_bytes_of_a_line_are_told_only_to_those_who_may_read_every_unit(tmp_path):
    async with web_bench(CONFIG + LIMITED, tmp_path, token="t") as bench:
        bench.fan_out.emit(BAD)
        for host, heard in (("10.2.0.7", HEARD), ("10.2.0.8", None)):
            page = await bench.browser(host).get(f"{PATH}?level=warning&line=hall", Authorization="Bearer t")
            told = next(each for each in page.json["events"] if each["event"] == "bad_frame")
            assert told["heard"] == heard
            assert HEARD not in told["text"]


async def test_of_a_line_are_its_units_and_who_asked_them(bench):
    to_the_press = events.WriteAudit("10.2.0.7:5000", "scada", 47, 6, 1, 1, "ok", "", 4.0)
    by_name = events.WriteAudit("control", "control", 7, 6, 1, 1, "ok", "", 4.0, device="press")
    refused = events.RequestRefused("10.2.0.7:5000", 47, 9, "01", "no")
    for event in (AUDIT, to_the_press, by_name, BAD, refused, events.UnitRecovered("hall", 7, "press")):
        bench.fan_out.emit(event)
    found = [each["event"] for each in (await last(bench, "?line=hall"))["events"]][-5:]
    assert found == ["write_audit", "write_audit", "bad_frame", "request_refused", "unit_recovered"]
    assert [each["event"] for each in (await last(bench, "?unit=press"))["events"]] == found
    assert [each["event"] for each in (await last(bench, "?unit=47"))["events"]] == found
    assert [each["event"] for each in (await last(bench, "?unit=shift"))["events"]] == ["write_audit"]
