"""A write to bits of a register behind another server: a read, and a write before any other request to the unit."""

import pytest

from kit.asker import Asker
from kit.upstream_bench import UpstreamBench

SET = "16 00 08 FF EF 00 10"
READ = "03 00 08 00 01"
HELD = "03 02 12 01"
WRITE = "06 00 08 12 11"
OTHER_WRITE = "06 00 08 00 00"


def sent(bench: UpstreamBench) -> list[str]:
    return [request.pdu for request in bench.sent]


def asker(number: int) -> Asker:
    return Asker(f"10.0.0.{number}:1", host=f"10.0.0.{number}")


def test_it_reads_and_writes() -> None:
    bench = UpstreamBench()
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    assert sent(bench) == [READ, WRITE]
    assert bench.client.answers == []
    bench.respond(WRITE)
    assert bench.client.answers == [SET]
    assert bench.upstream.waiting == bench.upstream.under_way == 0


def test_no_other_request_to_the_unit_comes_between() -> None:
    bench = UpstreamBench(in_flight=8)
    other = asker(1)
    bench.ask(SET, in_one_turn=6)
    bench.ask(OTHER_WRITE, client=other)
    assert sent(bench) == [READ]
    bench.respond(HELD)
    assert sent(bench) == [READ, WRITE]
    bench.respond(WRITE)
    assert sent(bench) == [READ, WRITE, OTHER_WRITE]
    bench.ask(OTHER_WRITE, client=asker(2))
    assert sent(bench)[3:] == [OTHER_WRITE]


def test_a_unit_with_two_unit_ids_for_clients_is_one() -> None:
    bench = UpstreamBench(in_flight=8)
    bench.add_device(61, unit=7)
    bench.ask(SET, in_one_turn=6)
    bench.ask(OTHER_WRITE, unit=61, client=asker(1))
    assert sent(bench) == [READ]
    bench.respond(HELD)
    bench.respond(WRITE)
    assert sent(bench) == [READ, WRITE, OTHER_WRITE]
    bench.ask(SET, in_one_turn=6)
    assert sent(bench)[3:] == []
    bench.respond(OTHER_WRITE)
    assert sent(bench)[3:] == [READ]


def test_it_waits_for_what_is_under_way_to_the_unit() -> None:
    bench = UpstreamBench(in_flight=8)
    bench.ask(OTHER_WRITE, client=asker(1))
    bench.ask(SET, in_one_turn=6)
    assert sent(bench) == [OTHER_WRITE]
    bench.respond(OTHER_WRITE)
    assert sent(bench) == [OTHER_WRITE, READ]


def test_other_units_go_on() -> None:
    bench = UpstreamBench(in_flight=8)
    bench.ask(SET, in_one_turn=6)
    bench.ask(OTHER_WRITE, unit=38, client=asker(1))
    assert sent(bench) == [READ, OTHER_WRITE]


def test_two_writes_to_bits_of_one_unit_go_one_after_the_other() -> None:
    bench = UpstreamBench(in_flight=8)
    first, second = asker(1), asker(2)
    bench.ask(SET, client=first, in_one_turn=6)
    bench.ask("16 00 08 FF FE 00 00", client=second, in_one_turn=6)
    bench.respond(HELD)
    bench.respond(WRITE)
    assert sent(bench) == [READ, WRITE, READ]
    bench.respond("03 02 12 11")
    assert sent(bench)[3:] == ["06 00 08 12 10"]
    bench.respond("06 00 08 12 10")
    assert (first.answers, second.answers) == ([SET], ["16 00 08 FF FE 00 00"])


def test_exceptions_are_passed_on() -> None:
    bench = UpstreamBench()
    bench.ask(SET, in_one_turn=6)
    bench.respond("83 02")
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.respond("86 03")
    assert bench.client.answers == ["96 02", "96 03"]
    assert sent(bench) == [READ, READ, WRITE]


@pytest.mark.parametrize("retries", [0, 1])
def test_only_the_read_is_repeated(retries: int) -> None:
    bench = UpstreamBench(retries=retries)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.6)
    assert sent(bench) == [READ] * (1 + retries)
    if retries:
        bench.respond(HELD)
        bench.pass_time(0.6)
        assert sent(bench) == [READ, READ, WRITE]
    bench.pass_time(2.0)
    assert bench.client.answers == ["96 0B"]


def test_a_late_response_to_a_read_that_is_repeated_is_followed_by_one_write() -> None:
    bench = UpstreamBench(retries=1)
    bench.ask(SET, in_one_turn=6)
    bench.ask(OTHER_WRITE, client=asker(1))
    bench.pass_time(0.6)
    bench.respond(HELD, to=0)
    assert sent(bench) == [READ, READ, WRITE]
    bench.respond(HELD, to=1)
    assert sent(bench) == [READ, READ, WRITE]
    bench.respond(WRITE, to=2)
    assert bench.client.answers == [SET]
    assert sent(bench)[3:] == [OTHER_WRITE]


def test_a_late_response_to_a_read_that_has_failed_is_not_followed() -> None:
    bench = UpstreamBench()
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.6)
    bench.respond(HELD)
    assert bench.client.answers == ["96 0B"]
    assert sent(bench) == [READ]


def test_a_device_that_sleeps_is_woken_by_the_read() -> None:
    bench = UpstreamBench(wake=0.5)
    bench.ask(SET, in_one_turn=6)
    bench.pass_time(0.6)
    bench.respond(HELD)
    assert sent(bench) == [READ, READ, WRITE]


def test_the_write_waits_for_the_silence_and_nothing_overtakes_it() -> None:
    bench = UpstreamBench(in_flight=1, gap=0.1)
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.ask(OTHER_WRITE, unit=38, client=asker(1))
    bench.ask(OTHER_WRITE, client=asker(2))
    assert sent(bench) == [READ]
    bench.pass_time(0.11)
    assert sent(bench) == [READ, WRITE]


@pytest.mark.parametrize("is_orderly", [True, False])
def test_a_connection_that_is_lost_between_answers_0b_and_writes_nothing(is_orderly: bool) -> None:
    bench = UpstreamBench(gap=0.1)
    bench.ask(SET, in_one_turn=6)
    if is_orderly:
        bench.upstream.finish(bench.now)
        bench.respond(HELD)
    else:
        bench.respond(HELD)
        bench.upstream.port_down(bench.now)
    assert bench.client.answers == ["96 0B"]
    bench.connect()
    bench.pass_time(1.0)
    assert sent(bench) == [READ]


def test_a_client_that_leaves_between_has_cancelled_the_write() -> None:
    bench = UpstreamBench(gap=0.1)
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.client.gone = True
    bench.ask(OTHER_WRITE, client=asker(1))
    bench.pass_time(0.3)
    assert sent(bench) == [READ, OTHER_WRITE]


def test_a_write_that_is_lost_lets_others_go_on() -> None:
    bench = UpstreamBench(in_flight=8)
    bench.ask(SET, in_one_turn=6)
    bench.respond(HELD)
    bench.ask(OTHER_WRITE, client=asker(1))
    bench.pass_time(0.6)
    assert bench.client.answers == ["96 0B"]
    assert sent(bench) == [READ, WRITE, OTHER_WRITE]
