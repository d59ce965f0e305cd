"""What noise on a line costs: so many calls for each of its bytes, however it is cut, and whatever the line waits for.

What that is in time, tests/bench/noisy_line.py shows.
"""

import sys
from collections.abc import Callable

import pytest

from gateway.events import UnitRecovered, UnitResting
from gateway.lines.breaker import FAILURES
from gateway.timing.characters import LineTiming
from kit import line_bench, server_bench
from kit.line_bench import Bench
from kit.noise import noise
from kit.server_bench import ServerBench

#: So many calls for each byte, those of C included, and for each piece in which bytes come.
MOST_FOR_A_BYTE, MOST_FOR_A_PIECE = 16, 50
#: Bytes of noise; those before are not counted. More than any frame, so that every buffer is as full as it gets.
NOISE, BEFORE = noise(2000), noise(1500, seed=1)
SIZES = [1, 4, 16, 300]

Hear = Callable[[bytes], None]
EACH_MODE = pytest.mark.parametrize("timing", [line_bench.TIMING, line_bench.ASCII], ids=["rtu", "ascii"])
EACH_SIZE = pytest.mark.parametrize("size", SIZES)


def calls(hear: Hear, pieces: list[bytes]) -> int:
    """How many calls were made to hear this; none is seen in compiled modules."""
    count = 0

    def called(frame: object, event: str, what: object) -> None:
        nonlocal count
        count += event in {"call", "c_call"}

    before = sys.getprofile()
    sys.setprofile(called)
    try:
        for piece in pieces:
            hear(piece)
    finally:
        sys.setprofile(before)
    return count


def cut(data: bytes, size: int) -> list[bytes]:
    return [data[at : at + size] for at in range(0, len(data), size)]


def costs_little(hear: Hear, size: int) -> bool:
    for piece in cut(BEFORE, size):
        hear(piece)
    pieces = cut(NOISE, size)
    return calls(hear, pieces) <= MOST_FOR_A_BYTE * len(NOISE) + MOST_FOR_A_PIECE * len(pieces)


def on_line(bench: Bench) -> Hear:
    """Noise comes at the line's pace."""

    def hear(data: bytes) -> None:
        bench.now += len(data) * bench.settings.timing.character
        bench.line.received(data, bench.now)

    return hear


@pytest.mark.interpreted
@EACH_SIZE
@EACH_MODE
def test_an_idle_line(timing: LineTiming, size: int) -> None:
    assert costs_little(on_line(Bench(timing=timing)), size)


@pytest.mark.interpreted
@EACH_SIZE
@EACH_MODE
def test_a_line_with_thirty_resting_units(timing: LineTiming, size: int) -> None:
    bench = Bench(timing=timing)
    for unit in range(1, 31):
        bench.device(unit, timeout=0.02)
    for _ in range(FAILURES):
        for unit in range(1, 31):
            bench.asks(unit=unit)
    assert costs_little(on_line(bench), size)
    assert (len(bench.told(UnitResting)), bench.told(UnitRecovered)) == (30, [])


@pytest.mark.interpreted
@EACH_SIZE
@EACH_MODE
def test_a_line_whose_answer_is_awaited(timing: LineTiming, size: int) -> None:
    bench = Bench(timing=timing)
    bench.device(timeout=60.0)
    bench.ask()
    bench.pass_time(1.0)
    assert costs_little(on_line(bench), size)
    assert bench.client.answers == []


@pytest.mark.interpreted
@EACH_SIZE
@EACH_MODE
def test_a_line_on_which_a_late_answer_is_awaited_and_something_is_asked(timing: LineTiming, size: int) -> None:
    bench = Bench(timing=timing, late_window=60.0)
    bench.asks()
    bench.ask("04 00 10 00 01")
    assert costs_little(on_line(bench), size)
    assert bench.line.ledger.count_late(bench.now) == 1


@pytest.mark.interpreted
@EACH_SIZE
@pytest.mark.parametrize("timing", [server_bench.RTU, server_bench.ASCII], ids=["rtu", "ascii"])
def test_a_line_where_we_are_a_server(timing: LineTiming, size: int) -> None:
    assert costs_little(ServerBench(timing).hear, size)
