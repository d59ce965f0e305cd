"""However the bytes that come at one time are cut into chunks, the same comes of them."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.events import UnitRecovered
from gateway.lines.breaker import FAILURES
from gateway.timing.characters import LineTiming
from kit.line_bench import ASCII, READ, RESPONSE, TIMING, Bench

MODES = pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])

#: Frames of all kinds, each from here to there, and other bytes.
FRAMES = st.sampled_from(
    [
        *((1, pdu) for pdu in (RESPONSE, "03 02 00 07", "83 02", READ, "03 00 30 00 01", "06 00 01 00 05", "41 01 02")),
        *((2, pdu) for pdu in (RESPONSE, READ, "83 06")),
    ]
)
PIECES = st.tuples(FRAMES, st.sampled_from([0, 0, 0, 2, 5]), st.sampled_from([99, 99, 99, 3, 5, 7]))
#: What is asked or comes at one time, and how much time passes then.
STEPS = st.tuples(
    st.sampled_from(["", "", READ, "03 00 20 00 01", "06 00 01 00 05", "41 01"]),
    st.lists(st.one_of(PIECES, st.binary(max_size=4)), max_size=4),
    st.sampled_from([0.0, 0.01, 0.03, 0.3, 1.0]),
)


TOGETHER = pytest.mark.parametrize("is_together", [True, False], ids=["together", "apart"])


@MODES
@TOGETHER
def test_the_true_answer_that_comes_behind_an_ambiguous_one_is_late(timing: LineTiming, is_together: bool) -> None:
    bench = Bench(timing=timing)
    bench.ask()
    bench.respond("03 00 30 00 01")
    hear(bench, is_together, (1, "03 02 00 07"), (1, RESPONSE))
    assert (bench.client.answers, bench.counts.late_responses) == (["83 0B"], 1)
    assert bench.line.ledger.count_late(bench.now) == 0


@MODES
@TOGETHER
def test_a_unit_that_rests_is_heard_behind_the_answer_of_another(timing: LineTiming, is_together: bool) -> None:
    bench = Bench(timing=timing)
    let_rest(bench, unit=2)
    assert bench.asks(unit=2) == "83 0B"
    bench.ask()
    hear(bench, is_together, (1, RESPONSE), (2, "03 04 00 07 00 08"))
    assert len(bench.told(UnitRecovered)) == 1


@MODES
@TOGETHER
def test_a_frame_of_unknown_size_ends_with_the_last_byte_before_a_silence(
    timing: LineTiming, is_together: bool
) -> None:
    bench = Bench(timing=timing)
    let_rest(bench, unit=1)
    hear(bench, is_together, (1, "41 01 02"), (2, RESPONSE))
    bench.pass_time(0.02)
    assert len(bench.told(UnitRecovered)) == (timing is ASCII)  # there CR LF ends it
    hear(bench, is_together, (2, RESPONSE), (1, "41 01 02"))
    bench.pass_time(0.02)
    assert len(bench.told(UnitRecovered)) == 1


@MODES
@TOGETHER
def test_what_came_before_the_end_of_a_request_ends_no_rest_behind_it(timing: LineTiming, is_together: bool) -> None:
    bench = Bench(timing=timing)
    let_rest(bench, unit=1)
    bench.pass_time(5.0)
    bench.ask()
    data = [bench.frame(1, "03 00 30 00 01"), bench.frame(1, RESPONSE), "55"]
    for chunk in [" ".join(data)] if is_together else data:
        bench.hear(chunk)
    assert bench.client.answers[-1] == "83 0B"
    assert bench.told(UnitRecovered) == []


EXCHANGES = [(READ, RESPONSE), ("06 00 01 00 05", "06 00 01 00 05"), (READ, "83 02"), ("41 01", "41 01 02 03")]


@MODES
@pytest.mark.parametrize(("asked", "response"), EXCHANGES)
@pytest.mark.parametrize("at", [1, 5, -1])
def test_a_response_is_whole_even_if_the_gateway_stood_still_between_two_pieces_of_it(
    timing: LineTiming, asked: str, response: str, at: int
) -> None:
    """It reads first what has arrived. In ASCII, a second between two characters ends the frame (S 2.5.2.1)."""
    bench = Bench(timing=timing)
    bench.device(timeout=4.0)
    bench.ask(asked)
    bench.pass_time(0.02)
    data = bytes.fromhex(bench.frame(1, response))
    bench.line.received(data[:at], bench.now)
    bench.now += 3.0 if timing is TIMING else 0.9
    bench.line.received(data[at:], bench.now)
    bench.pass_time(0.1)
    assert bench.client.answers == [response]


def let_rest(bench: Bench, unit: int) -> None:
    for _ in range(FAILURES):
        bench.ask(unit=unit)
        bench.pass_time(1.0)


def hear(bench: Bench, is_together: bool, *frames: tuple[int, str]) -> None:
    data = [bench.frame(unit, pdu) for unit, pdu in frames]
    for chunk in [" ".join(data)] if is_together else data:
        bench.hear(chunk)


@pytest.mark.search
@MODES
@pytest.mark.parametrize(
    "settings", [{}, {"virtual": False}, {"echo": True, "virtual": False}, {"retries": 1}], ids=str
)
@given(
    rests=st.booleans(),
    steps=st.lists(STEPS, max_size=6),
    sizes=st.lists(st.integers(1, 12), min_size=1, max_size=20),
)
def test_the_same_comes_of_them(
    timing: LineTiming,
    settings: dict[str, object],
    rests: bool,
    steps: list[tuple[str, list[object], float]],
    sizes: list[int],
) -> None:
    outcomes = []
    for cut in ([4096], sizes):
        bench = Bench(timing=timing, gap=0.005, **settings)  # no request leaves between two chunks
        if rests:
            let_rest(bench, unit=1)
        for pdu, pieces, seconds in steps:
            if pdu:
                bench.ask(pdu)
                bench.pass_time(0.02)
            data = b"".join(as_bytes(bench, piece) for piece in pieces)
            for chunk in chunks(data, cut):
                bench.hear(chunk.hex())
            bench.pass_time(seconds)
        bench.pass_time(300.0)
        line = bench.line
        heard = line.attribution.overheard, line.unasked_bytes
        events = sorted(type(event).__name__ for event in bench.events)
        outcomes.append((bench.client.answers, repr(bench.counts), repr(heard), events, bench.written))
    assert outcomes[0] == outcomes[1]


def as_bytes(bench: Bench, piece: object) -> bytes:
    if isinstance(piece, bytes):
        return piece
    (unit, pdu), begin, end = piece
    return bytes.fromhex(bench.frame(unit, pdu))[begin:end]


def chunks(data: bytes, sizes: list[int]) -> Iterator[bytes]:
    at, number = 0, 0
    while at < len(data):
        size = sizes[number % len(sizes)]
        yield data[at : at + size]
        at, number = at + size, number + 1
