"""No fault of a line makes a client receive what is not the answer to its own request."""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Mapping

import pytest

from gateway.lines.last_reads import LastReads
from gateway.modbus.codes import Area
from gateway.ports.port import Port, PortUser
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.faulty import Fault, FaultyDevice, FaultyLine, word
from kit.gateway_bench import gateway_bench
from soak.kinds_of_lines import CONFIG
from soak.never_lies import WORLDS, run
from soak.noticing import is_noticed
from soak.outside import Socket
from soak.stalling_server import StallingServer
from soak.worlds.lines import play
from soak.worlds.over_tcp import POINTS

LINES: Mapping[str, LineTiming] = {
    "rtu": LineTiming("rtu", 19200, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 19200, CharacterFormat.parse("7E1")),
    "rtu-echo": LineTiming("rtu", 19200, CharacterFormat.parse("8E1")),
    "ascii-echo": LineTiming("ascii", 19200, CharacterFormat.parse("7E1")),
}
ONE_LINE = """
[[line]]
name    = "line"
port    = "/dev/line"
mode    = "{timing.mode}"
format  = "{timing.format}"
baud    = {timing.baud}
echo    = {echo}
devices = [{{ unit = "1-3", timeout = "50 ms" }}]
"""

#: Faults that cost nothing, and those after which no answer can be believed or none came.
HARMLESS = [
    Fault.DUPLICATE, Fault.STALE, Fault.NOISE_BEFORE, Fault.NOISE_BEHIND, Fault.HOLES, Fault.BABBLE,
]  # fmt: skip
FATAL = [
    Fault.LATE, Fault.LATE_EXCEPTION, Fault.NOISE_THEN_LATE, Fault.HALF_LATE, Fault.CUT, Fault.NOISE_BETWEEN,
    Fault.SILENT,
]  # fmt: skip
ECHO_FATAL = [Fault.ECHO_LOST, Fault.ECHO_DAMAGED, Fault.ECHO_ALONE]
#: Faults after which half of the devices answer rightly all the same; another client's read only hides a read's answer.
FOREIGN = [Fault.FOREIGN_UNIT, Fault.FOREIGN_FUNCTION, Fault.WRONG_SIZE, Fault.OTHER_CLIENT]


async def answers_under(fault: Fault, line: str, requests: int = 30) -> Counter[str]:
    """What becomes of reads and writes that all meet `fault`: 'right', '0B', or what was wrong."""
    timing, has_echo = LINES[line], line.endswith("echo")
    outcomes: Counter[str] = Counter()
    async with gateway_bench(ONE_LINE.format(timing=timing, echo=str(has_echo).lower())) as bench:
        devices = [FaultyDevice(unit, number=unit) for unit in (1, 2, 3)]
        faulty = FaultyLine(timing, *devices, share=1.0, seed=4, faults={fault: 1.0}, echo=has_echo)
        bench.attach("line", faulty)
        client = bench.client()
        for turn in range(requests):
            unit, address = 1 + turn % 3, 5 * turn
            right = f"03 02 {word(unit, Area.HOLDING, address):04X}"
            for pdu, answer in ((f"03 {address:04X} 0001", right), (f"06 {300 + turn:04X} {turn:04X}",) * 2):
                got = await client.asks(unit, pdu)
                plain = got.replace(" ", "")
                outcomes["right" if plain == answer.replace(" ", "") else got[-2:] if len(plain) == 4 else got] += 1
                await asyncio.sleep(25.0)  # longer than a unit rests at first, and than any late window
    assert faulty.injected[fault] > requests
    return outcomes


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("fault", HARMLESS)
async def test_a_right_answer_is_found_in_what_is_around_it(fault: Fault, line: str) -> None:
    assert set(await answers_under(fault, line)) == {"right"}


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("fault", FATAL)
async def test_where_no_answer_can_be_believed_there_is_none(fault: Fault, line: str) -> None:
    assert set(await answers_under(fault, line)) == {"0B"}


@pytest.mark.parametrize("line", ["rtu-echo", "ascii-echo"])
@pytest.mark.parametrize("fault", ECHO_FATAL)
async def test_without_its_echo_no_answer_is_believed(fault: Fault, line: str) -> None:
    assert set(await answers_under(fault, line)) == {"0B"}


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("fault", FOREIGN)
async def test_a_frame_that_does_not_fit_is_passed_over_and_the_answer_behind_it_is_found(
    fault: Fault, line: str
) -> None:
    outcomes = await answers_under(fault, line)
    assert set(outcomes) == {"right", "0B"}
    assert outcomes["right"] >= 15


@pytest.mark.search
async def test_twenty_thousand_transactions_with_every_fault_and_no_wrong_answer() -> None:
    tally = await play(transactions=20_000, share=0.2, seed=1)
    assert tally.wrong == []
    assert tally.wrong_count == 0
    for fault in Fault:
        assert tally.injected[fault] > 20, fault
    assert sum(count for (_, outcome), count in tally.outcomes.items() if outcome == "right data") > 10_000
    assert min(tally.counts["stalls"], tally.events["connection_renewed"]) > 50
    assert tally.counts["values shown"] > 10_000


@pytest.mark.search
@pytest.mark.interpreted
async def test_it_notices_values_that_are_shown_as_they_were_before_a_write(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LastReads, "written", lambda *_: None)
    assert await is_noticed(lambda seed: play(transactions=4_000, share=0.2, seed=seed))


@pytest.mark.search
async def test_it_notices_a_gateway_that_does_not_wait_for_late_answers() -> None:
    """Late windows of a millisecond: the run must find wrong answers, or it would find none of anybody's."""
    config = CONFIG.replace("echo    =", 'late_window = "1 ms"\n            echo    =')
    config = config.replace('            late_window = "300 ms"\n', "")
    assert await is_noticed(lambda seed: play(transactions=16_000, share=0.2, seed=seed, config=config))


@pytest.mark.search
async def test_it_notices_a_gateway_that_keeps_connections_to_servers_that_stall(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It does not if the port is no connection."""
    connect = StallingServer.open_port

    def as_a_port(server: StallingServer, user: PortUser) -> Awaitable[Port]:
        server.has_arrived = None
        return connect(server, user)

    monkeypatch.setattr(StallingServer, "open_port", as_a_port)
    assert await is_noticed(lambda seed: play(transactions=20_000, share=0.2, seed=seed))


@pytest.mark.search
def test_twenty_thousand_requests_over_tcp_to_a_gateway_that_stands_still_and_no_wrong_answer() -> None:
    tally = run("over_tcp", 20_000, 0.2, seed=1)
    assert tally.wrong == []
    assert tally.wrong_count == 0
    assert min(tally.injected[f"stand-still {point}"] for point in POINTS) > 20
    assert sum(count for (_, outcome), count in tally.outcomes.items() if outcome == "right data") > 8_000


@pytest.mark.search
async def test_it_notices_a_gateway_that_does_not_look_before_it_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Socket, "receive", lambda socket, room: 0)
    assert await is_noticed(lambda seed: WORLDS["over_tcp"](5_000, 0.2, seed))


@pytest.mark.parametrize("world", WORLDS)
def test_the_same_seed_gives_the_same_run(world: str) -> None:
    assert str(run(world, 250, 0.3, seed=9)) == str(run(world, 250, 0.3, seed=9))
