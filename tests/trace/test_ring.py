"""A ring keeps what came last, and no more bytes than it was given."""

import tracemalloc

import pytest

from gateway.errors import NoRoute
from gateway.events import discard_event
from gateway.lines.telling import Telling
from gateway.trace.records import Record, Refused, Sent
from gateway.trace.ring import FAILURES_SHARE, STEP, Ring
from kit.asker import Asker
from kit.line_bench import READ, Bench

KIB = 1024


def exchange(number: int, size: int = 20) -> Sent:
    """One whose PDUs nobody else holds, as those of writes."""
    request = bytes((16, *number.to_bytes(4, "big"), *bytes(size)))
    times = [1e6 + number + each / 8 for each in range(4)]
    return Sent(
        times[3],
        "hall-a",
        "silo",
        "10.2.0.7:49152",
        41,
        1,
        request,
        bytes(bytearray(request)),
        *times[:3],
        0.1 + number,
    )


def numbers(records: list[Record]) -> list[int]:
    return [round(record.at - 1e6 - 0.375) for record in records]


@pytest.mark.parametrize("size", [1, 20, 240])
def test_it_takes_no_more_memory_than_it_was_given(size):
    limit = 512 * KIB
    tracemalloc.start()
    try:
        ring = Ring(limit)
        for number in range(5000):
            ring.add(exchange(number, size))
        full, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    kept = ring.added - ring.first
    assert 0.45 * limit < full < limit  # compiled records are smaller
    assert kept > 500


def test_the_oldest_go_first():
    ring = Ring(64 * KIB)
    for number in range(1000):
        ring.add(exchange(number))
    kept = numbers(ring.after(0, 1000))
    assert kept == list(range(1000 - len(kept), 1000))
    assert (ring.first, ring.added) == (1000 - len(kept), 1000)
    assert ring.begins_at == pytest.approx(1e6 + ring.first, abs=1)


def test_a_reader_gets_the_next_ones_as_far_as_they_are_still_there():
    ring = Ring(1024 * KIB)
    for number in range(STEP + 10):
        ring.add(exchange(number))
    assert numbers(ring.after(0)) == list(range(STEP))
    assert numbers(ring.after(STEP)) == list(range(STEP, STEP + 10))
    assert ring.after(STEP + 10) == ring.after(10_000) == []
    for number in range(STEP + 10, 5000):
        ring.add(exchange(number))
    assert numbers(ring.after(0))[0] == ring.first > 0


def test_a_time_is_found():
    ring = Ring(64 * KIB)
    for number in range(1000):
        ring.add(exchange(number))
    assert ring.number_at(1e6 + 990) == 990
    assert ring.number_at(0) == ring.first
    assert ring.number_at(2e6) == 1000
    assert Ring(64 * KIB).number_at(0) == 0


def test_failures_have_a_part_of_it_to_themselves():
    ring, asker = Ring(64 * KIB), Asker()
    ring.refuse(asker.ask(READ), NoRoute(), 5.0)
    for number in range(1000):
        ring.add(exchange(number))
    assert [record.at for record in ring.failures()] == [5.0]
    for number in range(1000):
        ring.refuse(asker.ask(READ), NoRoute(), 10.0 + number)
    kept = list(ring.failures())
    assert kept[0].at == 1009.0
    assert sum(record.size for record in kept) <= 64 * KIB // FAILURES_SHARE


def test_another_size_keeps_what_fits():
    ring = Ring(64 * KIB)
    for number in range(1000):
        ring.add(exchange(number))
    before = ring.first
    ring.resize(128 * KIB)
    assert (ring.first, ring.added, numbers(ring.after(0, 1))) == (before, 1000, [before])
    ring.resize(32 * KIB + 64 * KIB)
    ring.resize(64 * KIB)
    assert ring.added == 1000
    assert numbers(ring.after(999)) == [999]
    ring.resize(0)
    assert (ring.is_on, ring.after(0), list(ring.failures()), ring.added) == (False, [], [], 1000)
    ring.resize(64 * KIB)
    ring.add(exchange(1000))
    assert numbers(ring.after(0)) == [1000]


def test_one_that_is_off_keeps_nothing():
    ring = Ring(0)
    telling = Telling("hall-a", "", discard_event, "rtu", ring)
    bench = Bench()
    assert bench.asks() == "83 0B"
    ring.refuse(bench.client.ask(READ), NoRoute(), 1.0)
    ring.add_port("hall-a", 1.0)
    telling.record_noise(b"x", 1, 1.0)
    assert (ring.added, list(ring.failures())) == (0, [])


def test_records_hold_no_session():
    """A client that has left is not kept in memory by what it has asked."""
    ring = Ring(64 * KIB)
    bench = Bench(ring=ring)
    bench.ask()
    bench.respond()
    (record,) = ring.after(0)
    assert isinstance(record, Sent)
    names = {name for kind in type(record).__mro__ for name in vars(kind) if not name.startswith("__")}
    held = [each for each in (getattr(record, name) for name in names) if not callable(each)]
    assert {type(each) for each in held} == {float, str, int, bytes}


def test_an_error_that_was_raised_keeps_no_frame():
    """Each would take more than its record is counted for, and keep the unit that raised it over a reload."""
    with pytest.raises(NoRoute) as raised:
        raise NoRoute
    assert raised.value.__traceback__ is not None
    record = Refused(1.0, "", "hall", "10.2.0.7:49152", 41, bytes.fromhex(READ), raised.value, 0.5)
    assert record.error.__traceback__ is None
