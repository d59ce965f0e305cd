"""Nobody looks at each byte of an answer, and nothing that matters is seen later for it, or differently."""

import asyncio
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.lines.pacing import HELD_BACK, LONGEST, LONGEST_UNPROVEN, NOISE, Pace
from gateway.modbus import ascii as ascii_framing
from gateway.modbus.codes import MAX_ASCII_ADU, MAX_RTU_ADU
from gateway.modbus.rtu import encode
from gateway.timing.characters import CharacterFormat, LineTiming, Mode
from kit.line_bench import ASCII, READ, REQUEST_TIME, TIMING, Bench
from kit.noise import noise
from kit.virtual_time import VirtualTimeLoop
from kit.wired import READ_TEN, Wired

CHARACTER = TIMING.character
#: The response to a read of ten registers, and its exception.
TEN = encode(1, bytes.fromhex("03 14") + bytes(range(20)))
EXCEPTION = encode(1, bytes.fromhex("83 02"))
ASCII_TEN = ascii_framing.encode(1, TEN[1:-2])
ASCII_EXCEPTION = ascii_framing.encode(1, EXCEPTION[1:-2])
#: A frame whose PDU is a function code.
SHORTEST_ASCII = len(ascii_framing.encode(1, b"\x03"))
CHARACTER_OF = {TIMING: TIMING.character, ASCII: ASCII.character}


# --- how long ---


def read_at(missing: int, character: float, *, proven: bool, virtual: bool = True) -> float | None:
    """When to read again, at 5.0 s; `proven`: a second byte has come at the line's rate."""
    pace = Pace(MAX_RTU_ADU)
    pace.tune(character, 3.5 * character, virtual=virtual)
    pace.begin()
    pace.add(1, 5.0 - character)
    if proven:
        pace.add(1, 5.0)
    return pace.read_at(missing, 5.0)


def test_the_last_byte_is_read_as_it_comes() -> None:
    assert read_at(21, 0.001, proven=True) == pytest.approx(5.020)


def test_an_adapter_may_have_held_back_what_it_handed_over() -> None:
    assert read_at(21, 0.001, proven=True, virtual=False) == pytest.approx(5.020 - HELD_BACK)


@pytest.mark.parametrize(("late", "held_back"), [(0.0001, 0.0), (0.0009, 0.0008), (0.5, HELD_BACK)])
def test_what_comes_late_in_a_bundle_is_followed_by_the_rest_so_much_sooner(late: float, held_back: float) -> None:
    pace = Pace(MAX_RTU_ADU)
    pace.tune(0.0001, 0.00035, virtual=True)
    pace.begin()
    pace.add(10, 5.0)
    pace.add(10, 5.001 + late)
    assert pace.read_at(31, 5.001 + late) == pytest.approx(5.001 + late + 30 * 0.0001 - held_back)


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_it_is_not_worth_it_for_two_bytes(missing: int) -> None:
    assert read_at(missing, 0.001, proven=True) is None


def test_a_lost_port_is_noticed_in_a_long_answer() -> None:
    assert read_at(256, 0.009, proven=True) == 5.0 + LONGEST


def test_a_pause_is_short_before_bytes_have_come_at_the_rate_of_the_line() -> None:
    assert read_at(22, 0.0005, proven=False) == 5.0 + LONGEST_UNPROVEN
    assert read_at(22, 0.009, proven=False) is None


@pytest.mark.parametrize(
    ("came", "seconds", "paced"),
    [(0, 0.0, True), (1, 0.0006, True), (1, 0.0002, False), (9, 0.0082, False), (9, 0.0086, True), (9, 0.03, True)],
)
def test_bytes_are_paced_that_take_as_long_as_on_a_line(came: int, seconds: float, paced: bool) -> None:
    pace = Pace(MAX_RTU_ADU)
    pace.tune(0.001, 0.0035, virtual=True)
    pace.begin()
    pace.add(1, 0.0)
    pace.add(came, seconds)
    assert (pace.read_at(100, seconds) is not None) == paced


@pytest.mark.parametrize(("character", "pauses"), [(NOISE / 2, True), (NOISE / 1.9, False)])
def test_noise_is_not_read_byte_by_byte_if_bytes_come_quickly(character: float, pauses: bool) -> None:
    pace = Pace(longest=1)
    pace.tune(character, 3.5 * character, virtual=True)
    pace.add_idle(2, 5.0)
    assert pace.read_idle_at(5.0) == (5.0 + NOISE if pauses else None)


# --- what a line knows ---


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.ask(READ_TEN)
    bench.pass_time(REQUEST_TIME + 0.01)
    return bench


def hear(bench: Bench, data: bytes) -> None:
    """All of it at once."""
    bench.hear(data.hex(" "))


def hear_paced(bench: Bench, data: bytes) -> None:
    for byte in data:
        bench.pass_time(bench.settings.timing.character)
        hear(bench, bytes((byte,)))


def away(bench: Bench) -> float | None:
    """For how many characters nobody need look."""
    at = bench.line.read_at(bench.now)
    return None if at is None else (at - bench.now) / CHARACTER


def test_after_its_first_byte_an_answer_may_be_an_exception(bench: Bench) -> None:
    hear(bench, TEN[:1])
    assert away(bench) == pytest.approx(len(EXCEPTION) - 1 - 1)


def test_once_its_head_is_known_the_whole_answer_is_waited_for(bench: Bench) -> None:
    hear_paced(bench, TEN[:3])
    assert away(bench) == pytest.approx(len(TEN) - 3 - 1)


def test_while_nothing_has_come_the_first_byte_is_waited_for(bench: Bench) -> None:
    assert away(bench) is None


def test_once_it_is_there_nothing_is_missing(bench: Bench) -> None:
    hear(bench, TEN)
    assert bench.client.answers
    assert away(bench) is None


def test_behind_noise_it_looks_at_each_byte(bench: Bench) -> None:
    hear(bench, b"\xff" * 5)
    assert away(bench) is None


def test_a_broken_answer_of_full_size_is_no_reason_to_look_away(bench: Bench) -> None:
    hear(bench, TEN[:-1] + b"\x00")
    assert away(bench) is None


def test_an_answer_of_unknown_size_is_looked_at(bench: Bench) -> None:
    bench.respond(READ_TEN)
    bench.pass_time(1.0)
    bench.ask("41 01 02 03")
    bench.pass_time(REQUEST_TIME + 0.01)
    bench.hear("01 41")
    assert away(bench) is None


def test_a_port_that_is_faster_than_its_rate_is_looked_at_however_long_the_device_has_thought(bench: Bench) -> None:
    hear(bench, TEN[:1])
    bench.pass_time(0.0002)
    hear(bench, TEN[1:3])
    assert away(bench) is None


def test_after_a_beginning_that_came_at_once_the_rest_may_come_at_once_too(bench: Bench) -> None:
    hear(bench, TEN[:3])
    assert away(bench) == pytest.approx(LONGEST_UNPROVEN / CHARACTER)


def test_a_real_port_may_have_held_bytes_back() -> None:
    bench = Bench(virtual=False)
    bench.ask(READ_TEN)
    bench.pass_time(REQUEST_TIME + 0.01)
    hear_paced(bench, TEN[:3])
    assert away(bench) == pytest.approx(len(TEN) - 3 - 1 - HELD_BACK / CHARACTER)


def test_while_a_late_answer_is_awaited_every_byte_is_looked_at(bench: Bench) -> None:
    bench.pass_time(0.5)
    bench.ask("04 00 10 00 0A")
    bench.pass_time(REQUEST_TIME + 0.01)
    bench.hear("01")
    assert away(bench) is None


@pytest.fixture
def noisy() -> Bench:
    """A line on which more noise comes than a frame has, without a silence."""
    bench = Bench()
    hear_paced(bench, noise(MAX_RTU_ADU + 1))
    return bench


def test_lasting_noise_is_not_looked_at_byte_by_byte(noisy: Bench) -> None:
    assert noisy.line.read_at(noisy.now) == noisy.now + NOISE
    noisy.pass_time(NOISE)
    hear(noisy, noise(int(NOISE / CHARACTER)))
    assert noisy.line.read_at(noisy.now) == noisy.now + NOISE


@pytest.mark.parametrize(("timing", "longest"), [(TIMING, MAX_RTU_ADU), (ASCII, MAX_ASCII_ADU)], ids=["rtu", "ascii"])
def test_what_may_be_a_frame_is_looked_at(timing: LineTiming, longest: int) -> None:
    bench = Bench(timing=timing)
    hear_paced(bench, noise(longest))
    assert away(bench) is None
    hear_paced(bench, b"\x55")
    assert away(bench) is not None


def test_after_a_silence_each_byte_is_looked_at(noisy: Bench) -> None:
    noisy.pass_time(0.01)
    hear(noisy, b"\x55")
    assert away(noisy) is None


def test_a_late_answer_is_not_overslept_in_noise(noisy: Bench) -> None:
    noisy.pass_time(0.01)
    assert noisy.asks() == "83 0B"
    noisy.ask("04 00 10 00 01")
    hear_paced(noisy, noise(2 * MAX_RTU_ADU))
    assert noisy.line.ledger.count_late(noisy.now)
    assert away(noisy) is None


def test_behind_a_broadcast_noise_must_last_again() -> None:
    """What comes first may be its echo."""
    bench = Bench()
    hear_paced(bench, noise(MAX_RTU_ADU + 1))
    bench.broadcast("06 00 01 00 05")
    bench.pass_time(bench.settings.silence_before_request + CHARACTER)
    assert bench.written
    hear(bench, b"\x55")
    assert away(bench) is None


@pytest.fixture
def ascii_bench() -> Bench:
    bench = Bench(timing=ASCII)
    bench.ask(READ_TEN)
    bench.pass_time(0.1)
    return bench


@pytest.mark.parametrize(
    ("come", "missing"),
    [
        (2, SHORTEST_ASCII - 2),
        (4, SHORTEST_ASCII - 4),
        (7, len(ASCII_EXCEPTION)),  # the head is known, but a colon may start anew
        (len(ASCII_TEN) - 6, 6),
    ],
)
def test_in_ascii_as_much_is_waited_for_as_the_shortest_answer_has(ascii_bench: Bench, come: int, missing: int) -> None:
    hear_paced(ascii_bench, ASCII_TEN[:come])
    assert away(ascii_bench) == pytest.approx((missing - 1) * CHARACTER_OF[ASCII] / CHARACTER)


@pytest.mark.parametrize("heard", [b":02031400010203", ASCII_TEN[:-4] + b"0000"])
def test_in_ascii_each_character_of_what_is_no_answer_is_looked_at(ascii_bench: Bench, heard: bytes) -> None:
    hear(ascii_bench, heard)
    assert away(ascii_bench) is None


# --- what a driver does about it ---


@pytest.mark.parametrize(
    ("mode", "format_", "virtual", "wakes"),
    [
        ("rtu", "8N1", True, {1200: 7, 9600: 4, 19200: 4, 38400: 4, 115200: 4}),
        ("rtu", "8N1", False, {1200: 8, 9600: 5, 19200: 6, 38400: 8, 115200: 16}),
        ("ascii", "7E1", True, {1200: 11, 9600: 9, 19200: 9, 38400: 8, 115200: 8}),
        ("ascii", "7E1", False, {1200: 12, 9600: 10, 19200: 13, 38400: 16, 115200: 51}),
    ],
    ids=["RTU, virtual", "RTU, real", "ASCII, virtual", "ASCII, real"],
)
async def test_so_often_an_answer_of_ten_registers_wakes_the_line_and_it_is_complete_on_its_last_byte(
    mode: Mode, format_: str, virtual: bool, wakes: dict[int, int]
) -> None:
    """The table in docs/adr/0011; RTU has 25 bytes, ASCII 51 characters."""
    counted = {}
    for baud in wakes:
        async with Wired(LineTiming(mode, baud, CharacterFormat.parse(format_)), virtual=virtual) as wired:
            await wired.asks()
            await wired.says(TEN if mode == "rtu" else ASCII_TEN)
            assert [len(answer) for answer in wired.client.answers] == [len("03 14") + 60]
            counted[baud] = wired.user.wakes
    assert counted == wakes


@pytest.mark.parametrize("damaged", [False, True])
@pytest.mark.parametrize("mode", ["rtu", "ascii"])
async def test_noise_wakes_the_line_each_5_ms_and_a_request_leaves_when_it_is_over(mode: Mode, damaged: bool) -> None:
    async with Wired(LineTiming(mode, 115200, CharacterFormat.parse("8N1"))) as wired:
        wired.user.damaged = damaged
        await wired.says(noise(MAX_ASCII_ADU))
        before = wired.user.wakes
        await wired.says(noise(11520, seed=1))
        assert wired.user.wakes - before < 1.05 / NOISE
        wired.device.submit(wired.client.ask(READ, now=wired.loop.time()), wired.loop.time())
        gap = wired.driver.line.settings.silence_before_request
        await wired.says(noise(1152, seed=2))
        assert bool(wired.memory.written) == (gap == 0.0)
        await asyncio.sleep(gap - CHARACTER)
        assert bool(wired.memory.written) == (gap == 0.0)
        await asyncio.sleep(gap + 2 * CHARACTER)
        assert wired.memory.written


async def test_a_port_that_cannot_wait_is_not_looked_at() -> None:
    async with Wired(looks_away=False) as wired:
        await wired.asks()
        limit_ends = wired.driver.line.deadline()
        wired.memory.deliver(TEN[:3])
        assert wired.driver._deadline() == limit_ends


async def test_who_has_looked_away_between_two_pieces_of_one_read_looks_again_after_the_last_one() -> None:
    """A read with damaged characters in it is handed over in pieces: the later ones may say that each byte counts."""
    async with Wired() as wired:
        await wired.asks()
        await wired.says(TEN[:1])
        await asyncio.sleep(3 * CHARACTER)
        wired.driver.received(TEN[1:4])
        assert wired.driver._read_at > wired.loop.time() + CHARACTER
        wired.driver.received(TEN[4:-1])
        await asyncio.sleep(0.0001)
        await wired.says(TEN[-1:])
        assert [answer[:5] for answer in wired.client.answers] == ["03 14"]


async def test_an_exception_is_answered_on_its_last_byte_though_a_long_answer_was_awaited() -> None:
    async with Wired() as wired:
        await wired.asks()
        await wired.says(EXCEPTION)
        assert wired.client.answers == ["83 02"]


@pytest.mark.parametrize("virtual", [True, False])
@pytest.mark.parametrize("baud", [1200, 9600, 19200, 115200])
@pytest.mark.parametrize(("first", "rest"), [(TEN[:3], TEN[3:]), (TEN[:16], TEN[16:]), (EXCEPTION[:1], EXCEPTION[1:])])
async def test_an_answer_that_comes_at_once_is_at_most_2_ms_late_however_long_the_device_has_thought(
    first: bytes, rest: bytes, baud: int, virtual: bool
) -> None:
    """A program behind a pseudo-terminal, or an adapter that is a device itself, does not keep the line's pace."""
    async with Wired(LineTiming("rtu", baud, CharacterFormat.parse("8N1")), virtual=virtual) as wired:
        await wired.asks()
        await asyncio.sleep(0.05)
        wired.memory.deliver(first)
        await asyncio.sleep(0.0002)
        wired.memory.deliver(rest)
        await asyncio.sleep(0.002)
        assert len(wired.client.answers) == 1


@pytest.mark.parametrize("come", [1, 3, 4, 5, 20, 24])
async def test_when_fewer_bytes_come_the_limit_runs_as_ever(come: int) -> None:
    async with Wired() as wired:
        await wired.asks()
        limit_ends = wired.driver.line.deadline()
        assert limit_ends is not None
        await wired.says(TEN[:come])
        await asyncio.sleep(limit_ends - wired.loop.time() - 0.0001)
        assert wired.client.answers == []
        await asyncio.sleep(0.0002)
        assert wired.client.answers == ["83 0B"]


async def test_bytes_that_wait_are_taken_before_the_limit_is_judged() -> None:
    """The answer is complete when the limit ends, but nobody has looked since its third byte."""
    async with Wired() as wired:
        await wired.asks()
        limit_ends = wired.driver.line.deadline()
        assert limit_ends is not None
        await asyncio.sleep(limit_ends - wired.loop.time() - 5 * CHARACTER)
        wired.memory.deliver(TEN[:3])
        wired.memory.deliver(TEN[3:])
        await asyncio.sleep(6 * CHARACTER)
        assert [answer[:5] for answer in wired.client.answers] == ["03 14"]


async def test_a_port_that_is_lost_while_nobody_looks_fails_the_request_at_once() -> None:
    async with Wired() as wired:
        await wired.asks()
        await wired.says(TEN[:3])
        wired.memory.pull()
        assert wired.client.answers == ["83 0B"]
        await asyncio.sleep(1.0)  # and the time to look passes


async def test_a_port_that_comes_back_is_looked_at() -> None:
    async with Wired() as wired:
        await wired.asks()
        await wired.says(TEN[:3])
        wired.memory.pull()
        wired.memory.plug()
        wired.driver.port_up(await wired.memory.open_port(wired.user))
        await asyncio.sleep(1.0)
        await wired.asks("04 00 10 00 0A")
        await wired.says(encode(1, bytes.fromhex("04 14") + bytes(20)))
        assert wired.client.answers[1:] == ["04 14" + " 00" * 20]


@pytest.mark.interpreted
async def test_a_defect_in_judging_when_to_look_stays_in_its_line() -> None:
    async with Wired() as wired:
        await wired.asks()

        def defect(now: float) -> None:
            raise ZeroDivisionError

        wired.driver.line.read_at = defect  # type: ignore[method-assign]
        await wired.says(TEN[:1])
        assert wired.client.answers == ["83 0B"]


#: Each mode's frames.
ENCODERS = {TIMING: encode, ASCII: ascii_framing.encode}
#: What may stand on a line: pieces of good frames of all kinds, and noise. A piece is a frame from here to there.
FRAMES = st.sampled_from([(1, TEN[1:-2]), (1, EXCEPTION[1:-2]), (1, bytes.fromhex(READ_TEN)), (2, TEN[1:-2])])
PIECES = st.tuples(FRAMES, st.sampled_from([0, 0, 0, 2, 5]), st.sampled_from([99, 99, 99, 3, 7, 20]))
SILENCES = st.sampled_from([0, 3, 40])
TRAFFIC = st.lists(st.tuples(st.one_of(PIECES, st.binary(max_size=6)), SILENCES), max_size=6)


@pytest.mark.search
@pytest.mark.parametrize("virtual", [True, False], ids=["virtual", "real"])
@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
@given(traffic=TRAFFIC)
def test_whoever_looks_away_hears_the_same(
    timing: LineTiming, virtual: bool, traffic: list[tuple[object, int]]
) -> None:
    said = [(as_said(piece, timing), silence) for piece, silence in traffic]
    away, here = (outcome(timing, said, virtual=virtual, looks_away=looks_away) for looks_away in (True, False))
    assert away == here


def as_said(piece: object, timing: LineTiming) -> bytes:
    """A piece of traffic as bytes on the line."""
    if isinstance(piece, bytes):
        return piece
    (unit, pdu), begin, end = piece  # type: ignore[misc]
    return ENCODERS[timing](unit, pdu)[begin:end]


def outcome(
    timing: LineTiming, traffic: list[tuple[bytes, int]], *, virtual: bool, looks_away: bool
) -> tuple[object, ...]:
    """Answers, counts and events of three requests while this is on the line; each piece with a silence behind it."""

    async def talk() -> tuple[object, ...]:
        async with Wired(timing, virtual=virtual, looks_away=looks_away) as wired:
            for pdu in (READ_TEN, READ, READ_TEN):
                await wired.asks(pdu)
                for data, silence in traffic:
                    await wired.says(data)
                    await asyncio.sleep(silence * timing.character)
                await asyncio.sleep(2.0)
            counts = {function: repr(each) for function, each in wired.device.counts.items()}
            line = wired.driver.line
            # when it was heard is when it was read
            heard = replace(line.attribution.overheard, copied_at=0.0, requested_at=0.0), line.unasked_bytes
            return wired.client.answers, counts, heard, [type(event) for event in wired.events], wired.memory.written

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(talk())
