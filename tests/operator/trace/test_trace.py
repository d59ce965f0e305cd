"""Pages of the ring, as they are fetched by those who follow. In virtual time."""

import asyncio
from typing import Any, Literal

import pytest

from gateway.errors import WrongQuestion
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.operator.operations.answers.trace import TracePage
from gateway.operator.operations.asked import ToExplain, Traced
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.trace.capture import heard_frame, packets
from gateway.operator.trace.reader import what_is_seen
from gateway.operator.trace.selection import lines
from gateway.operator.trace.stories import sentences
from gateway.operator.trace.trace import TAIL, page
from gateway.operator.trace.why import causes, stories
from gateway.operator.units.calibration import measured
from gateway.operator.values.frames import frames_of
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[[line]]
name    = "hall"
port    = "/dev/hall"
timeout = "120 ms"
devices = [{ unit = 1, as = 41, name = "silo" }, { unit = 3, as = 43, name = "press" }]

[[line]]
name = "axis"
port = "/dev/axis"
mode = "ascii"
devices = [{ unit = 2, as = 52 }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [41]

[[image]]
unit = 200
name = "shift"
holding = 2

[trace]
ring = "64 KiB"
"""
READ = "03 00 00 00 01"


def ask(home: GatewayBench, **question: Any) -> TracePage:
    now = asyncio.get_running_loop().time()
    return page(home.running, Traced(**question), (now, 1_800_000_000 + now))


def kinds(answer: TracePage) -> list[tuple[str, str]]:
    return [(fact["kind"], fact["line"]) for fact in answer.facts]


async def some(home: GatewayBench) -> None:
    """A transaction on the hall line, one that a client of the panel has asked for, an image, a unit without route."""
    home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(3)))
    client = home.client()
    for unit in (41, 43, 200, 99):
        await client.asks(unit, READ)


async def test_a_follower_gets_each_record_once() -> None:
    async with gateway_bench(CONFIG) as home:
        first = ask(home)
        assert set(kinds(first)) == {("port", "hall"), ("port", "axis"), ("port", "panel")}
        assert first.is_all
        assert ask(home, after=first.next).facts == []
        await some(home)
        answer = ask(home, after=first.next)
        assert kinds(answer) == [("exchange", "hall"), ("exchange", "hall"), ("answered", ""), ("refused", "")]
        assert ask(home, after=answer.next).facts == []


async def test_one_that_is_slow_is_told_how_much_it_has_missed() -> None:
    async with gateway_bench(CONFIG) as home:
        await some(home)
        client = home.client()
        for _ in range(500):
            await client.asks(200, READ)
        await asyncio.sleep(1.0)
        answer = ask(home, after=0)
        assert answer.missed == home.running.ring.first > 0
        assert not answer.is_all or len(answer.facts) == answer.next - answer.missed
        assert 0 < answer.reaches_back_s < 60


async def test_without_a_time_the_last_few_come_first() -> None:
    async with gateway_bench(CONFIG) as home:
        for _ in range(TAIL + 5):
            await home.client().asks(200, READ)
        assert len(ask(home).facts) == TAIL
        await asyncio.sleep(10.0)
        await home.client().asks(200, READ)
        assert len(ask(home, since=5.0).facts) == 1


async def test_lines_and_units_are_chosen() -> None:
    async with gateway_bench(CONFIG) as home:
        await some(home)
        home.lines["hall"].deliver(bytes.fromhex("03 03 02 00 01 00 44"))
        assert {line for _, line in kinds(ask(home, since=60, line="hall"))} == {"hall"}
        for unit in (43, "press"):
            found = ask(home, since=60, unit=unit).facts
            assert next((fact["kind"], fact["unit"]) for fact in found) == ("exchange", 43)
            assert all(fact["kind"] == "heard" or fact["unit"] == 43 for fact in found)
        with pytest.raises(WrongQuestion, match='there is no line "hal"; there are hall, axis, panel'):
            ask(home, line="hal")
        with pytest.raises(WrongQuestion, match='did you mean "press"'):
            ask(home, unit="pres")


async def test_a_client_on_a_server_line_has_its_frames_there() -> None:
    async with gateway_bench(CONFIG) as home:
        home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        home.lines["panel"].deliver(bytes.fromhex("29 03 00 00 00 01 82 22"))
        await asyncio.sleep(1.0)
        found = [fact for fact in ask(home, since=60).facts if fact["kind"] != "port"]
        assert [(fact["kind"], fact["line"], fact["client"]) for fact in found] == [
            ("exchange", "hall", "panel"),
            ("answered", "panel", "panel"),
        ]
        modes = {line.name: line.mode for line in lines(home.gateway)}
        assert [(each.line, each.is_request, each.is_sent) for fact in found for each in packets(fact, modes)] == [
            ("hall", True, True),
            ("hall", False, False),
            ("panel", True, False),
            ("panel", False, True),
        ]


NAMESAKES = (
    CONFIG
    + """
[[line]]
name = "yard"
port = "/dev/yard"

[[listen]]
bind = "tcp://127.0.0.1:5020"
[[listen]]
bind = "tcp://127.0.0.1:5021"
line = "yard"
[[listen]]
bind = "tcp://127.0.0.1:5022"
line = "axis"

[[access]]
listen = ["tcp://127.0.0.1:5021", "tcp://127.0.0.1:5022"]
allow = ["read"]
[[access]]
listen = ["tcp://127.0.0.1:5020"]
allow = ["read", "write"]
[[access]]
listen = ["web"]
units = [41]
allow = ["read"]
"""
)


async def ask_namesakes(home: GatewayBench) -> None:
    """Unit 41 of everybody, and that of who can reach one line only, which both answer with an exception."""
    home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
    home.attach("yard", SimulatedLine("rtu", SimulatedDevice(41)))
    for listener in (0, 1):
        await home.client(listener=listener).asks(41, "03 00 C8 00 01")
    await home.client(listener=1).asks(41, "06 00 01 00 07")  # has no right to
    await home.client(listener=2).asks(41, READ)  # is not there


async def test_a_unit_of_one_line_is_not_its_namesake_of_all_others() -> None:
    async with gateway_bench(NAMESAKES) as home:
        await ask_namesakes(home)
        told = [(each["unit"], each["name"]) for each in ask(home, since=60).facts if "unit" in each]
        assert told == [(41, "silo"), (41, "yard/41"), (41, "yard/41"), (41, "")]
        for unit in (41, "silo"):
            assert [each["name"] for each in ask(home, since=60, unit=unit).facts] == ["silo"]
        assert [each["name"] for each in stories(home.running, ToExplain("silo"), (0.0, 0.0)).stories] == ["silo"]
        assert len(causes(home.running, 41, 9, (0.0, 0.0), lambda _: True)) == 1


async def test_who_may_read_a_unit_does_not_see_its_namesake_on_another_line() -> None:
    async with gateway_bench(NAMESAKES) as home:
        await ask_namesakes(home)
        may_see = what_is_seen(home.running, "10.2.0.7")
        seen = [record.name for record in home.running.ring.failures() if may_see(record)]
        assert seen == ["silo"]


async def test_what_was_measured_of_a_unit_is_not_that_of_its_namesake() -> None:
    yard, others = NAMESAKES.rpartition("[[line]]")[1:], NAMESAKES.rpartition("[[line]]")[0]
    first = "".join(yard).replace("[[listen]]", others + "[[listen]]", 1)
    async with gateway_bench(first) as home:
        assert [line.name for line in home.gateway.lines] == ["yard", "hall", "axis"]
        assert measured(home.gateway, 41).name == "silo"
        assert measured(home.gateway, 7).name == "yard/7"


async def test_a_number_that_is_only_an_address_on_a_line_means_all_that_are_called_so() -> None:
    async with gateway_bench(NAMESAKES) as home:
        home.attach("yard", SimulatedLine("rtu", SimulatedDevice(7)))
        await home.client(listener=1).asks(7, READ)
        assert [each["name"] for each in ask(home, since=60, unit=7).facts] == ["yard/7"]


async def test_what_a_mirror_polls_is_told_of_its_device() -> None:
    mirrored = """
[[image]]
name = "copy"
unit = 210
of = "silo"
read = [{ holding = "0-1", every = "1 s" }]
stale = "5 s"
"""
    async with gateway_bench(CONFIG + mirrored) as home:
        home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        await asyncio.sleep(3.0)
        found = ask(home, since=60, unit="silo").facts
        assert {(each["client"], each["name"], each["address"]) for each in found} == {("mirror copy", "silo", 1)}


async def test_a_reload_keeps_the_ring() -> None:
    async with gateway_bench(CONFIG) as home:
        await some(home)
        before = home.running.ring.added
        home.running.apply(home.gateway)
        assert home.running.ring.added == before
        assert len(ask(home, since=60).facts) == before


async def test_the_client_on_a_server_line_is_called_as_the_line_is() -> None:
    async with gateway_bench(CONFIG) as home:
        home.attach("hall", SimulatedLine("rtu"))  # nobody answers
        home.lines["panel"].deliver(bytes.fromhex("29 03 00 00 00 01 82 22"))
        await asyncio.sleep(3.0)
        found = stories(home.running, ToExplain("panel"), (0.0, 0.0)).stories
        assert [(each["line"], each["client"]) for each in found] == [("hall", "panel")]


@pytest.mark.parametrize(
    "question",
    [{}, {"who": 41}, {"who": ""}, {"who": "9" * 5000}, {"who": "41", "count": 0}, {"who": "41", "count": "x"}],
)
async def test_a_wrong_question_is_refused(question: dict[str, Any]) -> None:
    async with gateway_bench(CONFIG) as home:
        with pytest.raises(WrongQuestion):
            stories(home.running, read_parameters(ToExplain, question), (0.0, 0.0))


async def test_the_frames_of_a_request_are_those_of_its_line() -> None:
    async with gateway_bench(CONFIG) as home:
        home.attach("axis", SimulatedLine("ascii", SimulatedDevice(2)))
        client, now = home.client(), asyncio.get_running_loop().time()
        await client.asks(52, READ)
        pdu = bytes.fromhex(READ)
        found = frames_of(home.running, client.session.caller.client, pdu, now)
        assert bytes.fromhex(found["sent"]) == b":020300000001FA\r\n"
        assert bytes.fromhex(found["received"]) == b":0203020000F9\r\n"
        assert frames_of(home.running, "somebody", pdu, now) == {}


@pytest.mark.parametrize(
    ("heard", "mode", "is_damaged"),
    [
        (bytes.fromhex("01 03 02 01 10 B8 18"), "rtu", False),
        (bytes.fromhex("01 03 02 01 10 B8 19"), "rtu", True),
        (b":0203020000F9\r\n", "ascii", False),
        (b":0203020000F8\r\n", "ascii", True),
        (b":02", "ascii", True),
        (b"garbage", "ascii", True),
        (b"", "rtu", True),
    ],
)
def test_a_wrong_check_sum_stays_wrong(heard: bytes, mode: str, is_damaged: bool) -> None:
    frame, told = heard_frame(heard, mode)
    assert told == is_damaged
    if mode == "ascii" and not is_damaged:
        assert heard_frame(frame, "rtu") == (frame, False)
    if heard.startswith(b":0203020000F8"):
        assert heard_frame(frame, "rtu") == (frame, True)


@pytest.mark.parametrize(
    ("line", "mode", "unit", "address"), [("hall", "rtu", 41, 1), ("axis", "ascii", 52, 2)], ids=["rtu", "ascii"]
)
async def test_frames_of_another_client_are_not_damaged_ones(
    line: str, mode: Literal["rtu", "ascii"], unit: int, address: int
) -> None:
    encode = rtu.encode if mode == "rtu" else ascii_framing.encode
    others = [encode(address, bytes.fromhex(pdu)) for pdu in ("03 00 02 00 01", "03 02 00 00")]
    async with gateway_bench(CONFIG) as home:
        device = SimulatedDevice(address)
        home.attach(line, SimulatedLine(mode, device))
        device.script.append([Answer(0.01, b"".join(others))])
        assert await home.client().asks(unit, "04 00 00 00 01") == "84 0B"
        (story,) = stories(home.running, ToExplain(str(unit)), (0.0, 0.0)).stories
        assert "(none of these 2 frames is the response to this request)." in sentences(story)
        modes = {each.name: each.mode for each in lines(home.gateway)}
        in_file = [each for fact in ask(home, since=60).facts for each in packets(fact, modes)]
        assert sorted((each.is_request, each.comment.split(",")[0]) for each in in_file if not each.is_sent) == [
            (False, "another client"),
            (True, "another's request"),
        ]
        assert not any(each.is_damaged for each in in_file)


async def test_records_are_chosen_by_function_client_and_result() -> None:
    async with gateway_bench(CONFIG) as home:
        home.attach("hall", SimulatedLine("rtu", SimulatedDevice(1)))
        one, other = home.client("10.2.0.7:5000"), home.client("[2001:db8::1]:5000")
        await one.asks(41, READ)
        await one.asks(41, "04 00 00 00 01")
        await other.asks(43, READ)  # nobody is there
        await other.asks(41, "03 00 C8 00 01")  # the device has no such address
        await one.asks(99, READ)

        def units(**question: Any) -> list[int]:
            return [fact["unit"] for fact in ask(home, since=60, **question).facts if "unit" in fact]

        assert units(function=4) == [41]
        assert units(function=3) == [41, 43, 41, 99]
        assert units(client="10.2.0.7") == [41, 41, 99]
        assert units(client="2001:db8::1") == units(client="[2001:db8::1]:5000") == [43, 41]
        assert units(client="10.2.0") == []
        assert units(result="ok") == [41, 41]
        assert units(result="exception") == [41]
        assert units(result="failed") == [43, 99]
        assert units(result="timeout") == [43]
        assert units(result="no_route", client="10.2.0.7", function=3) == [99]
        with pytest.raises(WrongQuestion, match="no result"):
            ask(home, result="good")
