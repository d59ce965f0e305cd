"""The limit of a transaction: response on the wire + margin x table + latency, each term computed by hand."""

import pytest

from gateway.modbus.pdu import parse_request
from gateway.timing.budget import AnswerTime, Budget, Pace
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.timing.table import Point, TimingTable

MINT = TimingTable.of(
    {
        3: [Point(1, 0.010), Point(99, 0.420)],
        16: [Point(1, 0.010), Point(99, 0.240)],
        23: [Point(1, 0.014), Point(99, 0.500)],
    }
)
#: 19200 baud and 10 bits a character, as the Mint application note has it: 0.5208 ms a character.
MINT_LINE = LineTiming("ascii", 19200, CharacterFormat.parse("7E1"))
CHARACTER = 10 / 19200
LATENCY = 0.005


def mint(**changes) -> AnswerTime:
    return AnswerTime(**{"table": MINT, "margin": 1.5, "timeout": 1.0, **changes})


def limit(pdu: bytes, answer_time: AnswerTime, latency: float = 0.0) -> float:
    return Budget(MINT_LINE, latency).limit(parse_request(pdu), answer_time)


def read(count: int) -> bytes:
    return bytes((3, 0, 1, 0, count))


def preset(count: int) -> bytes:
    return bytes((16, 0, 1, 0, count, 2 * count, *bytes(2 * count)))


def read_write(reads: int, writes: int) -> bytes:
    return bytes((23, 0, 1, 0, reads, 0, 1, 0, writes, 2 * writes, *bytes(2 * writes)))


@pytest.mark.parametrize(
    ("pdu", "characters", "table"),
    [
        # response: `:`, unit and function and count and data and LRC as two characters a byte, CR LF
        pytest.param(read(1), 1 + 2 * (1 + 4 + 1) + 2, 0.010, id="FC03, 1 register"),
        pytest.param(read(50), 1 + 2 * (1 + 102 + 1) + 2, 0.010 + 49 * 0.410 / 98, id="FC03, 50 registers"),
        pytest.param(read(99), 1 + 2 * (1 + 200 + 1) + 2, 0.420, id="FC03, 99 registers"),
        pytest.param(preset(1), 17, 0.010, id="FC16, 1 register"),
        pytest.param(preset(50), 17, 0.010 + 49 * 0.230 / 98, id="FC16, 50 registers"),
        pytest.param(preset(99), 17, 0.240, id="FC16, 99 registers"),
        pytest.param(read_write(1, 1), 15, 0.014, id="FC23, 1 read, 1 written"),
        pytest.param(read_write(99, 1), 407, 0.500, id="FC23, 99 read, 1 written"),
        pytest.param(read_write(1, 99), 15, 0.500, id="FC23, 1 read, 99 written"),
    ],
)
def test_limits_of_the_mint_table_at_19200_baud(pdu, characters, table):
    expected = characters * CHARACTER + 1.5 * table + LATENCY
    assert limit(pdu, mint(), LATENCY) == pytest.approx(expected, abs=1e-9)


def test_the_limits_of_the_mint_table_in_milliseconds():
    """The same, as an operator would read them."""
    limits = [round(1000 * limit(read(count), mint(), LATENCY), 1) for count in (1, 50, 99)]
    assert limits == [27.8, 437.4, 847.0]


def test_a_function_without_a_row_gets_the_timeout():
    assert limit(bytes.fromhex("05 00 01 FF 00"), mint()) == pytest.approx(17 * CHARACTER + 1.0)


def test_the_devices_own_timeout_stands_in_place_of_the_table():
    assert limit(read(99), mint(timeout=0.4, fixed=True)) == pytest.approx(407 * CHARACTER + 0.4)


def test_an_unknown_function_has_no_response_time_on_the_wire():
    assert limit(b"\x41", mint(), LATENCY) == pytest.approx(1.0 + LATENCY)


def test_the_request_on_the_wire_is_no_part_of_the_limit():
    wire = Budget(MINT_LINE, LATENCY).request_wire_time(parse_request(preset(99)))
    assert wire == pytest.approx((1 + 2 * (1 + 204 + 1) + 2) * CHARACTER)
    assert limit(preset(99), mint(fixed=True)) == limit(preset(98), mint(fixed=True))


def test_rtu_counts_eleven_bits_a_character():
    budget = Budget(LineTiming("rtu", 9600, CharacterFormat.parse("8E1")), latency=0.0)
    answer_time = AnswerTime(TimingTable(), 1.5, 0.2)
    assert budget.limit(parse_request(read(2)), answer_time) == pytest.approx((1 + 6 + 2) * 11 / 9600 + 0.2)


@pytest.mark.parametrize(
    ("changes", "slowest"),
    [
        pytest.param({}, 1.0, id="the timeout for functions without a row"),
        pytest.param({"timeout": 0.1}, 0.75, id="the table's longest with its margin"),
        pytest.param({"timeout": 0.1, "fixed": True}, 0.75, id="the same whatever its own timeout allows"),
    ],
)
def test_the_slowest_answer(changes, slowest):
    assert mint(**changes).slowest == pytest.approx(slowest)


READ_TEN = parse_request(bytes.fromhex("03 00 00 00 0A"))
RTU = LineTiming("rtu", 9600, CharacterFormat.parse("8E1"))
ASCII = LineTiming("ascii", 9600, CharacterFormat.parse("7E1"))
TABLE = TimingTable.of({3: [Point(1, 0.010), Point(10, 0.050)]})
NO_TABLE = TimingTable()
RTU_CHAR = 11 / 9600


def test_an_rtu_read_is_gap_request_answer_time_response_and_latency():
    # 8 characters of request, and 5 with 20 bytes of data.
    pace = Pace(RTU, gap=0.004, frame_end=0.004, latency=0.001)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx(0.004 + 8 * RTU_CHAR + 0.050 + 25 * RTU_CHAR + 0.001)


def test_no_device_answers_before_it_has_noticed_the_end_of_the_request():
    pace = Pace(RTU, gap=0.0, frame_end=0.004)
    assert pace.time_of(READ_TEN, NO_TABLE) == pytest.approx(33 * RTU_CHAR + 0.004)


def test_a_response_of_unknown_size_takes_at_least_no_time():
    pace = Pace(RTU, gap=0.0, frame_end=0.004)
    assert pace.time_of(parse_request(bytes.fromhex("41 01")), NO_TABLE) == pytest.approx(5 * RTU_CHAR + 0.004)


def test_an_ascii_read_takes_two_characters_for_each_byte():
    # : AA 03 0000 000A LL CR LF, and : AA 03 14 and 40 digits LL CR LF; ten bits for 7E1.
    pace = Pace(ASCII, gap=0.0, frame_end=0.0)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx((17 + 51) * 10 / 9600 + 0.050)


def test_bytes_take_no_time_without_a_wire():
    pace = Pace(None, gap=0.002, frame_end=0.004, latency=0.001)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx(0.002 + 0.050 + 0.001)
