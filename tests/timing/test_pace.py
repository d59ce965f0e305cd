"""How long a transaction takes a line up, worked out by hand."""

import pytest

from gateway.modbus.pdu import parse_request
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.timing.pace import Pace
from gateway.timing.table import Point, TimingTable

READ_TEN = parse_request(bytes.fromhex("03 00 00 00 0A"))
RTU = LineTiming("rtu", 9600, CharacterFormat.parse("8E1"))
ASCII = LineTiming("ascii", 9600, CharacterFormat.parse("7E1"))
TABLE = TimingTable.of({3: [Point(1, 0.010), Point(10, 0.050)]})
NO_TABLE = TimingTable()
CHARACTER = 11 / 9600


def test_an_rtu_read_is_gap_request_answer_time_response_and_latency():
    # 8 characters of request, and 5 with 20 bytes of data.
    pace = Pace(RTU, gap=0.004, frame_end=0.004, latency=0.001)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx(0.004 + 8 * CHARACTER + 0.050 + 25 * CHARACTER + 0.001)


def test_no_device_answers_before_it_has_noticed_the_end_of_the_request():
    pace = Pace(RTU, gap=0.0, frame_end=0.004)
    assert pace.time_of(READ_TEN, NO_TABLE) == pytest.approx(33 * CHARACTER + 0.004)


def test_a_response_of_unknown_size_takes_at_least_no_time():
    pace = Pace(RTU, gap=0.0, frame_end=0.004)
    assert pace.time_of(parse_request(bytes.fromhex("41 01")), NO_TABLE) == pytest.approx(5 * CHARACTER + 0.004)


def test_an_ascii_read_takes_two_characters_for_each_byte():
    # : AA 03 0000 000A LL CR LF, and : AA 03 14 and 40 digits LL CR LF; ten bits for 7E1.
    pace = Pace(ASCII, gap=0.0, frame_end=0.0)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx((17 + 51) * 10 / 9600 + 0.050)


def test_bytes_take_no_time_without_a_wire():
    pace = Pace(RTU, gap=0.002, frame_end=0.004, latency=0.001, has_wire=False)
    assert pace.time_of(READ_TEN, TABLE) == pytest.approx(0.002 + 0.050 + 0.001)
