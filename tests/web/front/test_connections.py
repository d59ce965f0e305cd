"""Connections to the web page: so many at a time, and none that keeps all others out."""

import asyncio

from gateway.web.front.connections import FIRST_REQUEST_WITHIN, MOST_CONNECTIONS, MOST_OF_ONE_ADDRESS
from kit.browser import Wire, web_bench

CONFIG = """
[[image]]
unit = 200
holding = 20
"""
HEALTH = "/healthz"


def held(bench, host: str, number: int) -> list:
    """Connections that have asked something, and are kept."""
    return [bench.browser(host).open(HEALTH) for _ in range(number)]


async def test_one_address_with_all_connections_loses_its_oldest_to_another_one(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        wires = held(bench, "10.0.0.66", MOST_CONNECTIONS)
        assert (await bench.browser("10.0.0.7").get(HEALTH)).text == "ok\n"
        assert [wire.is_closing() for wire in wires[:2]] == [True, False]


async def test_addresses_with_few_connections_each_keep_them(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        wires = []
        for number in range(MOST_CONNECTIONS // MOST_OF_ONE_ADDRESS):
            wires += held(bench, f"10.0.0.{number}", MOST_OF_ONE_ADDRESS)
        await asyncio.sleep(1)
        refused = bench.browser("10.0.1.1").open(HEALTH)
        await asyncio.sleep(1)
        assert refused.is_closing()
        assert not refused.received
        assert not any(wire.is_closing() for wire in wires)


async def test_those_that_ask_nothing_make_room_however_many_addresses_they_come_from(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        asked = held(bench, "10.0.1.1", 1)
        await asyncio.sleep(1)
        silent = [Wire(bench.connect(None), f"10.0.0.{number}") for number in range(MOST_CONNECTIONS - 1)]
        assert (await bench.browser("10.0.1.2").get(HEALTH)).text == "ok\n"
        assert [wire.is_closing() for wire in (*asked, *silent[:2])] == [False, True, False]


async def test_many_at_once_close_as_many(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        wires = held(bench, "10.0.0.66", MOST_CONNECTIONS)
        new = held(bench, "10.0.0.7", 5)
        await asyncio.sleep(1)
        assert all(wire.received for wire in new)
        assert sum(wire.is_closing() for wire in wires) == 5


async def test_who_asks_nothing_is_closed(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        asked = bench.browser().open(HEALTH)
        silent = [Wire(bench.connect(None), "10.0.0.7") for _ in range(2)]
        await asyncio.sleep(FIRST_REQUEST_WITHIN - 1)
        later = Wire(bench.connect(None), "10.0.0.7")
        assert not any(wire.is_closing() for wire in (asked, *silent))
        await asyncio.sleep(2)
        assert [wire.is_closing() for wire in (asked, *silent, later)] == [False, True, True, False]
        await asyncio.sleep(FIRST_REQUEST_WITHIN - 1)
        assert [wire.is_closing() for wire in (asked, later)] == [False, True]


async def test_connections_that_have_gone_leave_no_timer_behind(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        await bench.browser().get(HEALTH)
        timers = len(asyncio.get_running_loop()._scheduled)
        for _ in range(200):
            await bench.browser().get(HEALTH)
        assert len(asyncio.get_running_loop()._scheduled) - timers < 50


async def test_requests_that_come_together_begin_one_in_a_turn_of_the_loop(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        wires = held(bench, "10.0.0.7", 20)
        in_turns, done = [], 0
        while done < len(wires):
            await asyncio.sleep(0)
            before, done = done, sum(bool(wire.received) for wire in wires)
            in_turns.append(done - before)
        assert max(in_turns) == 1
