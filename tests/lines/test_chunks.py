"""However the bytes that come at one time are cut into chunks, the same comes of them."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

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


def let_rest(bench: Bench, unit: int) -> None:
    for _ in range(FAILURES):
        bench.ask(unit=unit)
        bench.pass_time(1.0)


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
