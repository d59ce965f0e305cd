"""What a line leaves in the ring beside its transactions: what else was heard on it, and whose that was."""

import pytest

from gateway.lines.ledger import FOREIGN_OCCUPIES
from gateway.modbus.rtu import encode
from gateway.trace.records import Heard, Incident, Record, Refused, Sent
from gateway.trace.ring import Ring
from kit.asker import Asker
from kit.line_bench import READ, REQUEST_TIME, RESPONSE, Bench, frame


def bench_with_ring(**settings: object) -> tuple[Bench, Ring]:
    ring = Ring(2**20)
    return Bench(ring=ring, **settings), ring


def heard(ring: Ring) -> list[tuple[str, str, int]]:
    return [(each.kind, each.frame.hex(" ").upper(), each.count) for each in ring.after(0) if isinstance(each, Heard)]


def kinds(ring: Ring) -> list[type[Record]]:
    return [type(each) for each in ring.after(0)]


def test_a_transaction_has_its_times_and_the_limit():
    bench, ring = bench_with_ring()
    asked_at = bench.now
    bench.ask()
    bench.now += 0.05
    bench.respond()
    (record,) = ring.after(0)
    assert isinstance(record, Sent)
    assert (record.line, record.client, record.unit, record.address) == ("hall-a", "10.0.0.9:49152", 1, 1)
    assert (record.request, record.response) == (bytes.fromhex(READ), bytes.fromhex(RESPONSE))
    assert (record.sent_at, record.at) == (asked_at, bench.now)
    assert record.ends_at > asked_at
    assert record.limit == pytest.approx(0.2, abs=0.01)


def test_clients_that_share_a_transaction_are_all_in_it():
    bench, ring = bench_with_ring()
    bench.ask("04 00 00 00 01")
    bench.ask()
    bench.ask(client=Asker("10.0.0.8:1"))
    bench.respond("04 02 00 00")
    bench.pass_time(0.01)
    bench.respond()
    _, record = ring.after(0)
    assert isinstance(record, Incident)
    assert [client for client, _, _ in record.others] == ["10.0.0.8:1"]


def test_a_broadcast_is_there_without_a_response():
    bench, ring = bench_with_ring()
    bench.broadcast("06 00 01 00 05")
    (record,) = ring.after(0)
    assert type(record) is Sent
    assert (record.address, record.response) == (0, None)


def test_a_late_answer_is_named_as_one():
    bench, ring = bench_with_ring()
    bench.ask()
    bench.pass_time(0.3)
    bench.respond()
    record, late = ring.after(0)
    assert isinstance(record, Incident)
    assert record.late_until > record.at - 1
    assert isinstance(late, Heard)
    assert heard(ring) == [("a late response", "01 " + RESPONSE, 1)]


def test_noise_before_an_answer():
    bench, ring = bench_with_ring()
    bench.ask()
    bench.hear("00 FF")
    bench.respond()
    assert heard(ring) == [("noise", "00 FF", 2)]
    assert kinds(ring)[-1] is Sent


def test_frames_of_others_while_nothing_is_asked():
    bench, ring = bench_with_ring()
    bench.hear(frame(7, READ))
    bench.hear(frame(7, RESPONSE))
    bench.hear(frame(8, "03 02 00 00"))
    assert [kind for kind, _, _ in heard(ring)] == ["another's request", "another client", "nobody"]


def test_an_echo_is_told_only_where_nobody_expects_it():
    for echo, told in ((False, ["an echo"]), (True, [])):
        bench, ring = bench_with_ring(echo=echo, virtual=False)
        bench.ask()
        bench.now += REQUEST_TIME
        bench.hear(frame(1, READ))
        bench.respond()
        assert [kind for kind, _, _ in heard(ring)] == told


def test_what_came_instead_of_an_answer_is_kept_up_to_a_bound():
    bench, ring = bench_with_ring()
    bench.ask()
    broken = encode(1, bytes.fromhex(RESPONSE))[:-1] + b"\0"
    bench.hear(broken.hex())
    bench.hear("55" * 600)
    bench.pass_time(1.0)
    (record,) = ring.after(0)
    assert isinstance(record, Incident)
    assert record.error.result == "bad_frame"
    assert record.heard[: len(broken)] == broken
    assert len(record.heard) == 256


def test_so_is_what_came_before_a_read_is_sent_again():
    bench, ring = bench_with_ring(retries=1)
    bench.hear(frame(1, "03 00 30 00 01"))  # whose response it may be: the late window comes first
    bench.pass_time(FOREIGN_OCCUPIES)
    bench.ask()
    bench.hear("55 AA")
    bench.pass_time(0.5)
    (record,) = (each for each in ring.after(0) if isinstance(each, Incident))
    assert (record.error, record.heard) == (None, b"\x55\xaa")


def test_a_read_that_is_sent_again_at_once_has_no_late_window():
    bench, ring = bench_with_ring(retries=1)
    bench.ask()
    bench.hear("55 AA")
    bench.pass_time(0.3)
    (record,) = (each for each in ring.after(0) if isinstance(each, Incident))
    assert (record.error, record.late_until) == (None, 0.0)


def test_a_lost_port_has_nothing_of_the_request_before():
    bench, ring = bench_with_ring()
    bench.ask()
    bench.hear("55 AA")
    bench.pass_time(1.0)
    bench.ask("04 00 10 00 01")
    bench.unplug()
    assert [each.heard for each in ring.after(0) if isinstance(each, Incident)] == [b"\x55\xaa", b""]


def test_what_is_refused_has_its_reason_and_until_when_it_is():
    bench, ring = bench_with_ring(late_window=5.0)
    bench.ask()
    bench.pass_time(1.0)
    bench.ask()
    (record,) = (each for each in ring.after(0) if isinstance(each, Refused))
    assert (record.line, record.name, record.unit, record.error.result) == ("hall-a", "unit-1", 1, "overdue")
    assert record.until == bench.line.ledger.next_end()


def test_where_an_echo_is_expected_other_frames_are_kept():
    bench, ring = bench_with_ring(echo=True)
    bench.hear(frame(7, READ))
    assert [kind for kind, _, _ in heard(ring)] == ["another's request"]


def test_what_a_full_queue_loses_has_how_many_waited_and_no_time():
    bench, ring = bench_with_ring(queue=2)
    for number in range(4):
        bench.ask(f"03 00 10 00 0{number + 1}", client=Asker(f"10.0.0.{number // 3}:1"))
    (record,) = (each for each in ring.after(0) if isinstance(each, Refused))
    assert (record.error.result, record.count, record.until) == ("queue_full", 2, 0.0)


def test_whoever_is_refused_by_a_full_queue_has_no_time_either():
    bench, ring = bench_with_ring(queue=1)
    for number in range(3):
        bench.ask(f"03 00 10 00 0{number + 1}")
    (record,) = (each for each in ring.after(0) if isinstance(each, Refused))
    assert (record.error.result, record.count, record.until) == ("queue_full", 1, 0.0)


def test_what_a_resting_unit_is_asked_has_the_end_of_the_rest():
    bench, ring = bench_with_ring(late_window=0.0)
    for _ in range(3):
        bench.ask()
        bench.pass_time(0.3)
    bench.ask()
    (record,) = (each for each in ring.after(0) if isinstance(each, Refused))
    assert (record.error.result, record.count) == ("resting", 3)
    assert record.until == pytest.approx(bench.now + bench.devices[1].breaker.rest_left(bench.now))
