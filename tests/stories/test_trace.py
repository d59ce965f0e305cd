"""`trace --why`: a request that fails in each of ten ways, and the story that is told of it. In virtual time."""

import asyncio
import re
from collections.abc import Iterator

import pytest

from gateway.cli.show.trace_rows import rows
from gateway.errors import WrongQuestion
from gateway.modbus.rtu import encode
from gateway.operator.operations.asked import ToExplain, Traced
from gateway.operator.trace.stories import sentences, told
from gateway.operator.trace.trace import page
from gateway.operator.trace.why import stories
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name    = "hall"
port    = "/dev/hall"
timeout = "120 ms"
queue   = 2
max_wait = "300 ms"
devices = [
  { unit = 1, as = 41, name = "silo" },
  { unit = 3, as = 43, name = "press" },
  { unit = 4, as = 44, name = "slow", timeout = "900 ms" },
]
"""
READ = "03 00 00 00 01"
CLIENT = "10.2.0.7:49152"
#: Every time of the day in a story.
TIME = re.compile(r"\d\d:\d\d:\d\d\.\d{3}")


def attach(home: GatewayBench, *units: int) -> list[SimulatedDevice]:
    devices = [SimulatedDevice(unit) for unit in units]
    home.attach("hall", SimulatedLine("rtu", *devices))
    return devices


def clock() -> tuple[float, float]:
    now = asyncio.get_running_loop().time()
    return now, 1_800_000_000 + now


def why(home: GatewayBench, who: str = CLIENT, count: int = 5) -> list[str]:
    """The stories, newest first, with TIME for each time of the day."""
    found = stories(home.running, ToExplain(who, count), clock()).stories
    return [TIME.sub("TIME", sentences(story)) for story in found]


def shown(home: GatewayBench, **question: object) -> Iterator[str]:
    """The rows of a trace without the time."""
    for fact in page(home.running, Traced(since=3600, **question), clock()).facts:
        for row in rows(fact):
            yield f"{row.line} {row.way} {row.unit} {row.text}"


async def test_no_route() -> None:
    async with gateway_bench(CONFIG) as home:
        assert await home.client(CLIENT).asks(9, READ) == "83 0A"
        assert why(home) == [
            (
                "There is no route to unit 9: no such unit. Nothing was sent. The result was exception 0A, gateway "
                "path unavailable."
            )
        ]


async def test_a_line_that_is_down_because_of_a_question() -> None:
    async with gateway_bench(CONFIG) as home:
        home.lines["hall"].pull("/dev/hall does not exist: is the adapter plugged in?")
        await asyncio.sleep(1.0)
        assert await home.client(CLIENT).asks(41, READ) == "83 0A"
        assert "plugged in? Nothing was sent." in why(home)[0]


async def test_line_down() -> None:
    async with gateway_bench(CONFIG) as home:
        home.lines["hall"].pull("it was pulled")
        await asyncio.sleep(1.0)
        assert await home.client(CLIENT).asks(41, READ) == "83 0A"
        (story,) = why(home)
        assert story.startswith("Line hall was down: ")
        assert story.endswith("Nothing was sent. The result was exception 0A, gateway path unavailable.")
        home.lines["hall"].plug()
        await asyncio.sleep(5.0)
        assert why(home)[0].startswith("Line hall was down, and is up now. ")
        assert [row for row in shown(home) if "port" in row] == [
            "hall !  port open",
            "hall !  port lost: it was pulled",
            "hall !  port open",
        ]


async def test_silent_behind_another_unit() -> None:
    async with gateway_bench(CONFIG) as home:
        attach(home, 3)[0].delay = 0.04
        other, client = home.client(), home.client(CLIENT)
        other.ask(43, READ)
        assert await client.asks(41, READ) == "83 0B"
        (story,) = why(home)
        assert re.sub(r"\d+ ms", "N ms", story) == (
            "Waited N ms behind unit 43 (press) and was sent on line hall to address 1 at TIME. No response came "
            "within N ms. A late response was awaited until TIME (late window). The result was exception 0B, "
            "gateway target failed to respond."
        )
        waited = int(story.split()[1])
        assert 40 <= waited <= 60


async def test_spoiled_answer() -> None:
    async with gateway_bench(CONFIG) as home:
        (device,) = attach(home, 1)
        device.script.append([Answer(0.01, encode(1, bytes.fromhex("03 02 01 10"))[:-1] + b"\x00")])
        assert await home.client(CLIENT).asks(41, READ) == "83 0B"
        (story,) = why(home)
        assert "was no valid response: 01 03 02 01 10 B8 00 (it is damaged: no check sum fits)." in story
        assert "late window" not in story
        assert story.endswith("The result was exception 0B, gateway target failed to respond.")


async def test_an_answer_of_another_unit_is_no_damaged_one() -> None:
    async with gateway_bench(CONFIG) as home:
        (device,) = attach(home, 1)
        device.script.append([Answer(0.01, encode(9, bytes.fromhex("03 02 01 10")))])
        assert await home.client(CLIENT).asks(41, READ) == "83 0B"
        assert "(it is not the response to this request)." in why(home)[0]
        assert "hall < 9 03 read holding registers: 03 02 01 10  [not requested by anybody]" in shown(home)


async def test_resting() -> None:
    async with gateway_bench(CONFIG) as home:
        client = home.client(CLIENT)
        for _ in range(3):
            assert await client.asks(41, READ) == "83 0B"
            await asyncio.sleep(1.0)
        assert await client.asks(41, READ) == "83 0B"
        assert why(home)[0] == (
            "The unit had not answered 3 times in a row, and rests until TIME: it is left alone. Nothing was "
            "sent. The result was exception 0B, gateway target failed to respond."
        )


async def test_late_window() -> None:
    async with gateway_bench(CONFIG) as home:
        client = home.client(CLIENT)
        assert await client.asks(44, READ) == "83 0B"
        assert await client.asks(44, READ) == "83 0B"
        assert why(home)[0] == (
            "An earlier request to this unit got no response within its limit. It may still come until TIME (late"
            " window) and could be taken for the response to this one. Nothing was sent. The result was exception "
            "0B, gateway target failed to respond."
        )


async def test_a_request_that_waits_when_a_late_window_opens_is_told_the_same() -> None:
    async with gateway_bench(CONFIG) as home:
        first, client = home.client(), home.client(CLIENT)
        first.ask(41, READ)
        assert await client.asks(41, "03 00 01 00 01") == "83 0B"
        assert why(home)[0].startswith("An earlier request to this unit got no response within its limit.")


async def test_queue_full() -> None:
    async with gateway_bench(CONFIG) as home:
        other, client = home.client(), home.client(CLIENT)
        other.ask(44, READ)
        client.ask(43, READ)
        client.ask(43, "04 00 00 00 01")
        client.ask(43, "01 00 00 00 01")
        assert await client.answer() == "81 06"
        assert why(home)[0] == (
            "2 requests waited for line hall already: its queue was full. Nothing was sent. The result was "
            "exception 06, server device busy."
        )


async def test_a_request_that_makes_room_for_another_client_is_told_too() -> None:
    async with gateway_bench(CONFIG) as home:
        other, client = home.client(), home.client(CLIENT)
        other.ask(44, READ)
        client.ask(43, READ)
        client.ask(43, "04 00 00 00 01")
        home.client("10.2.0.8:1").ask(41, READ)
        assert await client.answer() == "84 06"
        assert "requests waited for line hall already: its queue was full." in why(home)[0]


async def test_expired() -> None:
    async with gateway_bench(CONFIG) as home:
        other, client = home.client(), home.client(CLIENT)
        other.ask(44, READ)
        assert await client.asks(41, READ) == "83 06"
        await asyncio.sleep(1.0)
        assert why(home) == [
            (
                "Waited 300 ms behind unit 44 (slow) for line hall, which is longer than its max_wait. Nothing was "
                "sent. The result was exception 06, server device busy."
            )
        ]


async def test_denied() -> None:
    async with gateway_bench(CONFIG) as home:
        assert await home.client(CLIENT, host="10.2.0.7").asks(41, "06 00 00 00 01") == "86 01"
        assert why(home, "10.2.0.7") == [
            (
                "The client has no right to this through default: [[access]] says who may do what. Nothing was sent. "
                "The result was exception 01, illegal function."
            )
        ]


async def test_malformed() -> None:
    async with gateway_bench(CONFIG) as home:
        assert await home.client(CLIENT).asks(41, "03 00 00 00 00") == "83 03"
        assert why(home, "silo") == [
            (
                "It was refused: function 03: the quantity must be 1 to 125: 03 00 00 00 00. Nothing was sent. The "
                "result was exception 03, illegal data value."
            )
        ]


async def test_an_exception_of_the_unit_is_told_as_its_own() -> None:
    async with gateway_bench(CONFIG) as home:
        attach(home, 1)[0].refuses[3] = 2
        assert await home.client(CLIENT).asks(41, READ) == "83 02"
        (story,) = why(home, "41")
        assert "The unit itself answered with an exception after " in story
        assert story.endswith("it was passed on unchanged. The result was exception 02, illegal data address.")


async def test_a_port_that_is_lost_on_the_way() -> None:
    async with gateway_bench(CONFIG) as home:
        client = home.client(CLIENT)
        client.ask(41, READ)
        await asyncio.sleep(0.05)
        home.lines["hall"].pull("it was pulled")
        assert await client.answer() == "83 0B"
        assert "The port was lost after " in why(home)[0]


async def test_a_read_that_is_sent_again_has_a_row_for_each_sending() -> None:
    async with gateway_bench(CONFIG.replace("queue ", "retries = 1\nqueue ")) as home:
        (device,) = attach(home, 1)
        device.script.append([])
        assert await home.client(CLIENT).asks(41, READ) == "03 02 00 00"
        assert [row.partition("  [")[0] for row in shown(home) if "port" not in row] == [
            "hall > 1 read holding 0 (40001)",
            "hall - 1 no response",
            "hall > 1 read holding 0 (40001)",
            "hall < 1 0",
        ]
        assert why(home) == []


async def test_a_read_that_is_sent_again_does_not_wait_behind_itself() -> None:
    async with gateway_bench(CONFIG.replace("queue ", "retries = 1\nqueue ")) as home:
        attach(home)  # nobody answers
        assert await home.client(CLIENT).asks(41, READ) == "83 0B"
        (story,) = why(home)
        assert re.match(r"Waited \d+ ms and was sent once more on line hall", story)


async def test_who_is_found_by_number_name_client_and_address_and_nobody_else() -> None:
    async with gateway_bench(CONFIG) as home:
        await home.client(CLIENT).asks(41, READ)
        await home.client("[fe80::1]:502").asks(9, READ)
        found = {who: len(why(home, who)) for who in ("41", "silo", "10.2.0.7", CLIENT, "fe80::1", "43", "10.2.0.70")}
        assert found == {"41": 1, "silo": 1, "10.2.0.7": 1, CLIENT: 1, "fe80::1": 1, "43": 0, "10.2.0.70": 0}
        assert why(home, "10.2.0.7:1") == why(home, "[fe80::1]:1") == []
        for who, error in {
            "sil": 'nothing has the name "sil"; did you mean "silo"?',
            "10.2.0.300": 'nothing has the name "10.2.0.300"',
            "256": '"unit" must be a number from 0 to 255, or a name',
        }.items():
            with pytest.raises(WrongQuestion, match=re.escape(error)):
                why(home, who)
        answer = stories(home.running, ToExplain("43"), clock())
        assert answer.clients_that_failed == [CLIENT, "[fe80::1]:502"]


async def test_a_line_has_the_stories_of_all_its_units_and_of_nobody_else() -> None:
    async with gateway_bench(CONFIG) as home:
        client = home.client(CLIENT)
        assert why(home, "hall") == []
        for unit in (41, 43, 9):
            await client.asks(unit, READ)
        assert len(why(home)) == 3
        answer = stories(home.running, ToExplain("hall"), clock())
        assert [story["unit"] for story in answer.stories] == [43, 41]


async def test_failures_are_kept_longer_than_what_was_answered() -> None:
    async with gateway_bench(CONFIG + '[trace]\nring = "64 KiB"\n') as home:
        attach(home, 1)
        client = home.client(CLIENT)
        assert await client.asks(9, READ) == "83 0A"
        for _ in range(300):
            await client.asks(41, READ)
        assert not any("not sent" in row for row in shown(home))
        assert len(why(home)) == 1


async def test_a_story_has_a_heading_that_says_who_asked_what() -> None:
    async with gateway_bench(CONFIG) as home:
        await home.client(CLIENT).asks(41, READ)
        (story,) = stories(home.running, ToExplain("41"), clock()).stories
        heading, *text = told(story).splitlines()
        assert TIME.sub("TIME", heading) == f"TIME  {CLIENT} asked unit 41 (silo): read holding 0 (40001)"
        assert all(line.startswith("  ") and len(line) <= 80 for line in text)
