"""Which records a reader gets who takes a bounded number of them."""

from gateway.errors import Busy
from gateway.operator.trace.sampling import Sample
from gateway.trace.records import Incident, Refused, Sent


def exchange(at: float) -> Sent:
    return Sent(at, "hall", "silo", "c", 1, 1, b"\x03", b"\x03", at, at, at, 1.0)


def incident(at: float) -> Incident:
    return Incident(at, "hall", "silo", "c", 1, 1, b"\x03", None, at, at, at, 1.0)


def test_all_pass_while_there_is_room() -> None:
    sample = Sample(10, 0.0)
    records = [exchange(at) for at in range(10)]
    assert sample.of(records, 0.0) == records
    assert sample.taken() == 0


def test_the_others_are_counted_once() -> None:
    sample = Sample(10, 0.0)
    assert len(sample.of([exchange(at) for at in range(25)], 0.0)) == 10
    assert (sample.taken(), sample.taken()) == (15, 0)


def test_they_are_taken_at_even_distances_and_in_their_order() -> None:
    chosen = Sample(5, 0.0).of([exchange(at) for at in range(100)], 0.0)
    assert [record.at for record in chosen] == [0, 20, 40, 60, 80]


def test_failures_go_first() -> None:
    records = [exchange(at) for at in range(100)]
    records[33], records[77] = incident(33), Refused(77, "hall", "", "c", 1, b"\x03", Busy(), 77)
    chosen = Sample(4, 0.0).of(records, 0.0)
    assert len(chosen) == 4
    assert {33, 77} <= {record.at for record in chosen}


def test_too_many_failures_are_bounded_too() -> None:
    assert len(Sample(4, 0.0).of([incident(at) for at in range(100)], 0.0)) == 4


def test_room_comes_back_with_time_and_is_bounded() -> None:
    sample, records = Sample(10, 0.0), [exchange(at) for at in range(100)]
    sample.of(records, 0.0)
    assert len(sample.of(records, 0.5)) == 5
    assert len(sample.of(records, 0.55)) == 0
    assert len(sample.of(records, 60.0)) == 10
