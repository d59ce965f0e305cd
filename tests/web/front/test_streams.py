"""Events for browsers: as they come, and never at the cost of the lines. In virtual time, without sockets."""

import asyncio
import json

import pytest

from gateway import events
from gateway.observe.fan_out import MOST_IN_A_SECOND, MOST_WAITING, FanOut
from gateway.web.front.streams import HEARTBEAT, MOST_READERS, WRITE_TIME
from kit.browser import web_bench

CONFIG = """
[[image]]
unit = 200
holding = 10
"""
EVENTS = "/api/v1/events"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


def told(wire) -> list[dict]:
    text = wire.received.decode()
    return [json.loads(line.partition("data: ")[2]) for line in text.splitlines() if line.startswith("data: ")]


async def emit(bench, number: int, *, every: float = 0.1) -> None:
    for count in range(number):
        bench.fan_out.emit(events.WebUp(f"{count:04}" * 1000))
        await asyncio.sleep(every)


async def test_events_come_as_json_from_the_level_info_on(bench):
    wire = bench.browser().open(EVENTS)
    await asyncio.sleep(1)
    assert b"text/event-stream" in wire.received
    bench.fan_out.emit(events.WebUp("http://here"))
    bench.fan_out.emit(events.ClientConnected("scada", "10.0.0.1:5"))
    await asyncio.sleep(1)
    (event,) = told(wire)
    assert (event["event"], event["level"], event["address"]) == ("web_up", "info", "http://here")
    assert "timestamp" in event
    wire.close()


HEARD = "07 03 04 DE AD BE EF 00 00"
#: The events that tell bytes of a line.
OF_BYTES = [
    events.BadFrame("hall", 7, "press", 3, 1.0, 2.0, "", HEARD, "wrong CRC"),
    events.ForeignFrame("hall", 7, "press", 3, HEARD),
    events.OtherClientHeard("hall", 7, "press", HEARD),
]
ROWS = """
[[access]]
listen = ["web"]
from = ["10.2.0.7"]
allow = ["read"]
[[access]]
listen = ["web"]
units = "8"
allow = ["read"]
"""


async def test_bytes_of_a_line_are_told_only_to_those_who_may_read_every_unit(tmp_path):
    async with web_bench(CONFIG + ROWS, tmp_path, token="t") as bench:
        all_units, some = [
            bench.browser(host).open(EVENTS, headers={"Authorization": "Bearer t"}) for host in ("10.2.0.7", "10.2.0.8")
        ]
        await asyncio.sleep(1)
        for event in OF_BYTES:
            bench.fan_out.emit(event)
        await asyncio.sleep(1)
        assert [event.get("heard") or event.get("frame") for event in told(all_units)] == [HEARD] * 3
        hidden = [{**each, name: None} for each in told(all_units) for name in ("heard", "frame") if name in each]
        assert told(some) == hidden


async def test_a_quiet_stream_has_a_heartbeat(bench):
    wire = bench.browser().open(EVENTS)
    await asyncio.sleep(HEARTBEAT * 3 + 1)
    assert wire.received.count(b"\r\n: \n\n") == 3
    wire.close()


async def test_a_reader_that_does_not_read_is_dropped(bench):
    wire = bench.browser().open(EVENTS, room=2000)
    other = bench.browser().open(EVENTS)
    await asyncio.sleep(1)
    await emit(bench, 50)
    assert not wire.closed.is_set()
    await asyncio.sleep(WRITE_TIME)
    assert wire.closed.is_set()
    assert len(wire.received) < 100_000
    assert not other.closed.is_set()
    assert len(told(other)) == 50
    assert len(bench.fan_out._followers) == 1
    other.close()


async def test_a_reader_that_is_too_slow_for_so_many_events_is_dropped(bench):
    wire = bench.browser().open(EVENTS, room=2000)
    await asyncio.sleep(1)
    await emit(bench, MOST_WAITING + 50, every=0.02)
    assert len(bench.fan_out._followers) == 1
    assert all(not follower._waiting for follower in bench.fan_out._followers)
    await asyncio.sleep(WRITE_TIME)
    assert wire.closed.is_set()
    assert not bench.fan_out._followers


async def test_a_reader_that_lost_events_is_dropped_even_if_it_reads_again(bench):
    wire = bench.browser().open(EVENTS, room=2000)
    await asyncio.sleep(1)
    await emit(bench, MOST_WAITING + 50, every=0.02)
    wire.protocol.resume_writing()
    await asyncio.sleep(0.1)
    await emit(bench, 1)
    assert wire.closed.is_set()


async def test_of_many_events_in_a_second_the_first_are_told_and_the_others_counted():
    left = []
    fan_out = FanOut(left.append)
    with fan_out.following() as follower:
        for _ in range(MOST_IN_A_SECOND + 30):
            fan_out.emit(events.WebUp("x"))
        await asyncio.sleep(0)
        await asyncio.sleep(1)
        fan_out.emit(events.WebUp("y"))
        await asyncio.sleep(0)
        texts = [json.loads(text) for text in await follower.next(1.0)]
    assert len(left) == MOST_IN_A_SECOND + 31
    assert [text["event"] for text in texts].count("web_up") == MOST_IN_A_SECOND + 1
    (count,) = (text["count"] for text in texts if text["event"] == "events_left_out")
    assert count == 30


async def test_one_reader_does_not_take_all_places(bench):
    vera = bench.browser("10.0.0.66")
    await vera.log_in("vera")
    wires = []
    for _ in range(MOST_READERS):  # of 128 connections, she may have as many
        wires.append(vera.open(EVENTS))
        await asyncio.sleep(0.1)
    anna = bench.browser("10.0.0.66")
    await anna.log_in("anna")
    for browser in (anna, bench.browser()):
        wire = browser.open(EVENTS)
        await asyncio.sleep(1)
        assert b"200 OK" in wire.received
    assert [wire.closed.is_set() for wire in wires[:3]] == [True, True, False]
    assert (await vera.get(EVENTS)).status == 503  # and so her pages do not push out one another
    assert not wires[2].closed.is_set()


async def test_readers_have_a_bound_and_leave_their_places(bench):
    wires = [bench.browser().open(EVENTS) for _ in range(MOST_READERS)]
    await asyncio.sleep(1)
    page = await bench.browser().get(EVENTS)
    assert (page.status, page.headers["Retry-After"]) == (503, "30")
    assert (await bench.browser().get("/healthz")).status == 200
    for wire in wires:
        wire.close()
    await asyncio.sleep(HEARTBEAT + 1)
    wire = bench.browser().open(EVENTS)
    await asyncio.sleep(1)
    assert b"200 OK" in wire.received
    wire.close()


async def test_a_stream_ends_with_its_session(bench):
    browser = bench.browser("10.2.0.7")
    await browser.log_in("vera")
    wire = browser.open(EVENTS)
    await asyncio.sleep(1)
    assert b"200 OK" in wire.received
    await browser.post("/logout", {"csrf": browser.csrf})
    await asyncio.sleep(HEARTBEAT + 1)
    await emit(bench, 3)
    assert told(wire) == []


async def test_streams_do_not_delay_the_end(tmp_path):
    loop = asyncio.get_running_loop()
    async with web_bench(CONFIG, tmp_path) as bench:
        wires = [bench.browser().open(EVENTS) for _ in range(3)]
        await asyncio.sleep(1)
        before = loop.time()
    assert loop.time() - before < 0.5
    assert all(wire.closed.is_set() for wire in wires)


async def test_who_connects_and_asks_nothing_is_dropped(bench):
    wire = bench.browser().open("/healthz")
    silent = type(wire)(bench.connect(), "10.0.0.9")
    dripping = type(wire)(bench.connect(), "10.0.0.9")
    dripping.arrive(b"GET / HT")
    await asyncio.sleep(19)
    assert not silent.closed.is_set()
    await asyncio.sleep(2)
    assert silent.closed.is_set()
    assert dripping.closed.is_set()
    assert not wire.closed.is_set()
    await asyncio.sleep(76)
    assert wire.closed.is_set()


async def test_a_body_that_never_ends_is_given_up(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    head = {"Origin": f"http://{browser.name}", "Content-Length": "100", "X-CSRF-Token": browser.csrf}
    wire = browser.open("/api/v1/units/200/holding/0", method="PUT", body=b'{"values"', headers=head)
    await asyncio.sleep(11)
    assert b"408" in wire.received
    wire.close()
