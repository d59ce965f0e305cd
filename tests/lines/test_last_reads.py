"""What is kept of the responses to reads: which, how many, and when it may have changed since."""

from gateway.lines.last_reads import MOST_READS, LastReads
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span, parse_request
from gateway.request import Caller

CALLER = Caller.without_address("10.2.0.7:49152")


def read(start: int, count: int = 1) -> bytes:
    return b"\x03" + start.to_bytes(2, "big") + count.to_bytes(2, "big")


def answer(reads: LastReads, pdu: bytes, response: bytes = b"\x03\x02\0\0", at: float = 1.0, unit: int = 1) -> None:
    reads.answered(parse_request(pdu), response, CALLER, unit, at, at + 0.1)


def starts(reads: LastReads, unit: int = 1) -> list[int]:
    return [last.span.start for last in reads.of(unit)]


def test_the_last_response_to_each_read_is_kept() -> None:
    reads = LastReads()
    answer(reads, read(5), b"\x03\x02\0\1")
    answer(reads, read(6), b"\x03\x02\0\2")
    answer(reads, read(5), b"\x03\x02\0\3", at=2.0)
    five, six = reads.of(1)
    assert (five.span, five.response, five.asked_at) == (Span(Area.HOLDING, 5, 1), b"\x03\x02\0\3", 2.0)
    assert (six.response, six.caller) == (b"\x03\x02\0\2", CALLER)


def test_what_it_answered_at_another_address_does_not_count() -> None:
    reads = LastReads()
    answer(reads, read(5))
    answer(reads, read(6))
    answer(reads, read(6), unit=2)
    assert (starts(reads), starts(reads, 2)) == ([5], [6])


def test_there_is_room_for_so_many_reads_and_the_newest_stay() -> None:
    reads = LastReads()
    for start in range(MOST_READS):
        answer(reads, read(start), at=float(start))
    answer(reads, read(0), at=500.0)
    answer(reads, read(MOST_READS), at=501.0)
    assert len(starts(reads)) == MOST_READS // 2 + 1
    assert {0, MOST_READS - 1, MOST_READS} <= set(starts(reads))
    assert 1 not in starts(reads)


def test_many_points_have_room_for_a_read_each() -> None:
    reads = LastReads(points=400)
    for start in range(800):
        answer(reads, read(start), at=float(start))
    assert len(starts(reads)) == 800


def test_a_write_makes_what_it_touches_outdated_until_the_next_read() -> None:
    reads = LastReads()
    answer(reads, read(5, 3))
    answer(reads, read(20))
    answer(reads, bytes.fromhex("06 0007 0001"), at=2.0)
    assert [last.outdated for last in reads.of(1)] == [True, False]
    answer(reads, read(5, 3), at=3.0)
    assert [last.outdated for last in reads.of(1)] == [False, False]


def test_a_write_of_unknown_meaning_may_have_changed_everything() -> None:
    reads = LastReads()
    answer(reads, read(5))
    answer(reads, b"\x41\x01", b"\x41\x01", at=2.0)
    assert [last.outdated for last in reads.of(1)] == [True]


def test_a_read_under_way_during_a_write_may_be_of_before() -> None:
    reads = LastReads()
    reads.written(Span(Area.HOLDING, 5, 1), 2.0)
    answer(reads, read(5), at=1.5)
    assert [last.outdated for last in reads.of(1)] == [True]


def test_function_23_is_a_write_and_the_read_after_it() -> None:
    reads = LastReads()
    answer(reads, read(5))
    answer(reads, bytes.fromhex("17 0005 0001 0005 0001 02 0009"), b"\x17\x02\0\x09", at=2.0)
    (last,) = reads.of(1)
    assert (last.response[2:], last.outdated, last.asked_at) == (b"\0\x09", False, 2.0)


def test_function_23_under_way_during_another_write_may_have_read_before_it() -> None:
    reads = LastReads()
    reads.written(Span(Area.HOLDING, 5, 1), 2.0)
    answer(reads, bytes.fromhex("17 0005 0001 0005 0001 02 0009"), b"\x17\x02\0\x09", at=1.5)
    assert [last.outdated for last in reads.of(1)] == [True]
