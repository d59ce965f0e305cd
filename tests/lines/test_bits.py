"""A write to bits of a register, of a device without function 22: a read and a write that nothing comes between."""

import pytest

from gateway import events
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.pdu import parse_request
from gateway.profiles.profile import Profile
from kit.asker import Asker
from kit.line_bench import ASCII, REQUEST_TIME, Bench, is_empty

#: Bit 4 of register 8 becomes 1: AND FFEF, OR 0010.
SET = "16 00 08 FF EF 00 10"
READ = "03 00 08 00 01"
#: The register holds 1201 before.
HELD = "03 02 12 01"
WRITE = "06 00 08 12 11"
OTHER_WRITE = "06 00 08 00 00"
SOON = 0.02


def on_the_line(bench: Bench) -> list[str]:
    """The PDUs that were written, of whichever unit."""
    return [written[3:-6] for written in bench.written]


def test_it_reads_and_writes() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    assert bench.client.answers == []
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, WRITE]
    bench.respond(WRITE)
    assert bench.client.answers == [SET]
    assert is_empty(bench.line)


def test_it_writes_with_16_if_asked_to() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=16)
    bench.respond(HELD)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, "10 00 08 00 01 02 12 11"]
    bench.respond("10 00 08 00 01")
    assert bench.client.answers == [SET]


def test_it_works_on_ascii_lines() -> None:
    bench = Bench(timing=ASCII)
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.pass_time(SOON)
    bench.respond(WRITE)
    assert bench.client.answers == [SET]


def test_a_register_that_is_as_wanted_is_written_nevertheless() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond("03 02 12 11")
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, WRITE]


def test_a_device_with_function_22_gets_that() -> None:
    bench = Bench()
    bench.device(profile=Profile("masks", functions=frozenset({3, 6, 22})))
    bench.ask(SET, in_one_turn=6)
    assert on_the_line(bench) == [SET]


@pytest.mark.parametrize("functions", [{3}, {6}, {3, 16}])
def test_a_device_without_the_functions_for_it_is_not_asked(functions: set[int]) -> None:
    bench = Bench()
    bench.device(profile=Profile("poor", functions=frozenset(functions)))
    bench.ask(SET, in_one_turn=6)
    assert bench.client.answers == ["96 01"]
    assert bench.written == []


def test_the_client_s_own_22_is_left_alone() -> None:
    bench = Bench()
    bench.ask(SET)
    assert on_the_line(bench) == [SET]


def test_nothing_comes_between() -> None:
    """Neither a write that waits, nor an urgent one, nor a broadcast, nor the client's own next request."""
    bench = Bench()
    bench.device(2, urgent=True)
    other = Asker("10.0.0.8:1", host="10.0.0.8")
    bench.ask(SET, in_one_turn=6)
    bench.ask(OTHER_WRITE, client=other)
    bench.ask(OTHER_WRITE, 2, client=other)
    bench.broadcast(OTHER_WRITE, client=other)
    bench.ask(OTHER_WRITE)
    bench.respond(HELD)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, WRITE]
    bench.respond(WRITE)
    bench.pass_time(SOON)
    assert on_the_line(bench)[2] == OTHER_WRITE


def test_a_scan_does_not_come_between() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    asked = parse_request(bytes.fromhex(READ))
    scanned = bench.device(9)
    scan = ScanTransaction(Asker().ask(READ, unit=9), asked, scanned, awaits_second=False, patience=0.0)
    bench.line.submit(scan, bench.now)
    bench.line._scheduler._idle.others = 100
    bench.respond(HELD)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, WRITE]


def test_it_does_not_share_the_read_of_others() -> None:
    bench = Bench()
    first, second = Asker("10.0.0.8:1", host="10.0.0.8"), Asker("10.0.0.7:1", host="10.0.0.7")
    bench.ask("03 00 00 00 01")
    bench.ask(READ, client=first)
    bench.ask(SET, client=second, in_one_turn=6)
    bench.respond("03 02 00 00")
    for _ in range(3):
        bench.pass_time(SOON)
        bench.respond({READ: HELD}.get(on_the_line(bench)[-1], WRITE))
    assert sorted(on_the_line(bench)[1:]) == sorted([READ, READ, WRITE])
    assert (first.answers, second.answers) == ([HELD], [SET])


def test_an_exception_of_the_read_is_passed_on_and_nothing_is_written() -> None:
    bench = Bench()
    assert bench_asks(bench, "83 02") == ["96 02"]
    assert on_the_line(bench) == [READ]
    assert bench.counts.exception == 1
    assert bench.counts.ok == 0


def test_an_exception_of_the_write_is_passed_on() -> None:
    bench = Bench()
    assert bench_asks(bench, HELD, "86 03") == ["96 03"]


def test_without_a_response_to_the_read_nothing_is_written() -> None:
    bench = Bench()
    assert bench_asks(bench) == ["96 0B"]
    assert on_the_line(bench) == [READ]


def test_a_damaged_response_to_the_read_writes_nothing() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.hear("01 03 02 12 01 00 00")
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 0B"]
    assert on_the_line(bench) == [READ]


def test_a_late_response_to_the_read_writes_nothing() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.3)
    bench.respond(HELD)
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 0B"]
    assert on_the_line(bench) == [READ]


def test_without_a_response_the_write_is_not_repeated() -> None:
    bench = Bench(retries=3)
    assert bench_asks(bench, HELD) == ["96 0B"]
    assert on_the_line(bench) == [READ, WRITE]


def test_the_read_is_repeated() -> None:
    bench = Bench(retries=1)
    bench.ask(SET, in_one_turn=6)
    bench.hear("01 03 02 12 01 00 00")
    bench.pass_time(0.05)
    assert on_the_line(bench) == [READ, READ]
    bench.respond(HELD)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, READ, WRITE]


def test_a_device_that_sleeps_is_woken_by_the_read() -> None:
    bench = Bench()
    bench.device(wake=0.5)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.25)
    bench.respond(HELD)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, READ, WRITE]
    bench.respond(WRITE)
    assert bench.client.answers == [SET]


@pytest.mark.parametrize("late", [READ, WRITE, "10 00 00 00 01 02 00 00"])
def test_a_late_window_of_either_part_forbids_it(late: str) -> None:
    """The response to the write could be taken for another one; and an earlier write may still be carried out."""
    bench = Bench()
    bench.ask(late)
    bench.pass_time(0.25)
    bench.written.clear()
    bench.ask(SET, in_one_turn=6)
    assert bench.client.answers[-1] == "96 0B"
    assert bench.written == []


def test_a_late_window_of_another_read_does_not() -> None:
    bench = Bench()
    bench.ask("04 00 00 00 01")
    bench.pass_time(0.25)
    assert bench_asks(bench, HELD, WRITE)[-1] == SET


def test_a_client_that_leaves_before_the_write_has_cancelled_it() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.client.gone = True
    bench.pass_time(1.0)
    assert on_the_line(bench) == [READ]
    assert is_empty(bench.line)


def test_a_client_that_leaves_before_the_read_has_cancelled_it() -> None:
    bench = Bench()
    bench.ask("03 00 00 00 01")
    bench.ask(SET, in_one_turn=6)
    bench.client.gone = True
    bench.respond("03 02 00 00")
    bench.pass_time(SOON)
    assert len(bench.written) == 1


def test_another_client_on_the_line_forbids_it() -> None:
    bench = Bench()
    bench.hear("02 03 00 00 00 01 84 39")
    bench.pass_time(1.0)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 04"]
    assert bench.written == []
    bench.pass_time(300.0)
    assert bench_asks(bench, HELD, WRITE)[-1] == SET


def test_another_client_that_is_heard_between_forbids_the_write() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.hear("02 03 00 00 00 01 84 39")
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 04"]
    assert on_the_line(bench) == [READ]


def test_a_line_that_is_lost_between_answers_0b_and_writes_nothing() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.unplug()
    assert bench.client.answers == ["96 0B"]
    bench.plug()
    bench.pass_time(1.0)
    assert on_the_line(bench) == [READ]


@pytest.mark.parametrize("stops_before_the_response", [True, False])
def test_a_line_that_stops_between_answers_0b_and_writes_nothing(stops_before_the_response: bool) -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    if stops_before_the_response:
        bench.line.finish(bench.now)
    bench.respond(HELD)
    if not stops_before_the_response:
        bench.line.finish(bench.now)
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 0B"]
    assert on_the_line(bench) == [READ]


def test_the_write_waits_no_longer_than_the_read_may_take() -> None:
    bench = Bench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.line.be_silent(bench.now + 10.0)
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 0B"]
    bench.pass_time(10.0)
    assert on_the_line(bench) == [READ]


def test_a_lease_that_is_lost_between_forbids_the_write() -> None:
    bench = Bench()
    bench.share()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.has_lease = False
    bench.pass_time(1.0)
    assert bench.client.answers == ["96 0B"]
    assert on_the_line(bench) == [READ]


def test_it_counts_what_went_to_the_line() -> None:
    bench = Bench()
    bench_asks(bench, HELD, WRITE)
    counts = bench.devices[1].counts
    assert {function: (each.sent, each.responses, each.ok) for function, each in counts.items() if each.sent} == {
        3: (1, 1, 0),
        6: (1, 1, 1),
    }


def test_a_full_queue_does_not_lose_the_write() -> None:
    bench = Bench(queue=2)
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    others = [Asker(f"10.0.0.{each}:1", host=f"10.0.0.{each}") for each in range(4)]
    for other in others:
        bench.ask("03 00 00 00 01", client=other)
    bench.pass_time(SOON)
    assert on_the_line(bench) == [READ, WRITE]


def test_a_unit_that_rests_is_not_asked() -> None:
    bench = Bench()
    for _ in range(3):
        bench.asks("04 00 00 00 01")
    bench.ask(SET, in_one_turn=6)
    assert bench.client.answers[-1] == "96 0B"
    assert READ not in on_the_line(bench)


def test_silence_is_kept_between() -> None:
    bench = Bench(gap=0.05)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(REQUEST_TIME)
    bench.respond(HELD)
    bench.pass_time(0.049)
    assert on_the_line(bench) == [READ]
    bench.pass_time(0.002)
    assert on_the_line(bench) == [READ, WRITE]


def test_a_late_response_to_the_read_that_woke_the_device_is_not_that_to_the_write() -> None:
    bench = Bench()
    bench.device(wake=0.5)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.25)
    bench.respond(HELD)
    bench.pass_time(SOON)
    bench.respond("03 02 00 00")
    assert bench.client.answers == []
    bench.respond(WRITE)
    assert bench.client.answers == [SET]
    assert not bench.told(events.BadFrame)


def bench_asks(bench: Bench, *responses: str) -> list[str | None]:
    """The answers to a write to bits, whose parts get these responses; the last one none if there are too few."""
    bench.ask(SET, in_one_turn=6)
    for response in responses:
        bench.respond(response)
        bench.pass_time(SOON)
    bench.pass_time(0.5)
    return bench.client.answers
