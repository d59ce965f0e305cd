"""Lines behind device servers: what a connection may hold back, and what had not arrived is not answered."""

import pytest

from gateway.events import AnswerTooEarly
from kit.asker import Asker
from kit.line_bench import LIMIT, READ, READ_FRAME, REQUEST_TIME, RESPONSE, RESPONSE_FRAME, Bench, frame

OTHER = "04 00 10 00 01"
#: The window after READ has timed out.
WINDOW = 2 * LIMIT
TIME_OUT = REQUEST_TIME + LIMIT


@pytest.fixture
def bench() -> Bench:
    return Bench(connection=True)


def time_out(bench: Bench, pdu: str = READ, unit: int = 1) -> None:
    """Nobody answers a request; its late window begins now."""
    bench.ask(pdu, unit)
    bench.pass_time(TIME_OUT)


def must_renew(bench: Bench) -> bool:
    return bench.line.must_renew(bench.now)


# --- when a new connection is needed ---


def test_after_a_silent_window_nothing_is_sent_over_the_same_connection(bench: Bench) -> None:
    time_out(bench)
    bench.now += WINDOW - 1e-6
    assert not must_renew(bench)
    bench.now += 2e-6
    assert must_renew(bench)
    assert bench.line.deadline() <= bench.now
    bench.ask(unit=2)
    assert bench.written == [READ_FRAME]


def test_a_port_that_is_no_connection_stays(bench: Bench) -> None:
    serial = Bench()
    time_out(serial)
    serial.pass_time(WINDOW)
    assert not must_renew(serial)


def test_an_answer_to_what_was_asked_since_shows_that_nothing_is_held_back(bench: Bench) -> None:
    time_out(bench)
    bench.ask(unit=2)
    bench.respond(unit=2)
    bench.pass_time(WINDOW)
    assert not must_renew(bench)


def test_a_late_answer_shows_it_for_what_was_asked_before_and_not_for_what_was_asked_since(bench: Bench) -> None:
    time_out(bench)
    time_out(bench, unit=2)
    bench.respond()
    bench.pass_time(WINDOW - TIME_OUT)
    assert not must_renew(bench)
    bench.pass_time(TIME_OUT)
    assert must_renew(bench)


@pytest.mark.parametrize("heard", ["01 03 02 01", "55 55", frame(7, RESPONSE)])
def test_who_hears_something_else_is_not_cut_off(bench: Bench, heard: str) -> None:
    bench.ask()
    bench.hear(heard)
    bench.pass_time(TIME_OUT + WINDOW)
    assert bench.client.answers == ["83 0B"]
    assert not must_renew(bench)


def test_what_is_on_the_line_when_a_window_ends_may_still_be_answered(bench: Bench) -> None:
    time_out(bench)
    bench.pass_time(WINDOW - 0.1)
    bench.ask(OTHER)
    bench.pass_time(0.15)
    assert not must_renew(bench)
    bench.respond("04 02 00 07")
    assert bench.client.answers == ["83 0B", "04 02 00 07"]
    assert not must_renew(bench)


# --- the new connection ---


def test_what_waits_is_sent_once_there_is_one_and_rests_go_on(bench: Bench) -> None:
    for _ in range(3):
        bench.line.renew(bench.now)
        bench.plug()
        bench.pass_time(0.1)
        time_out(bench)
        bench.pass_time(WINDOW)
    assert must_renew(bench)
    bench.line.renew(bench.now)
    bench.line.port_ended(lambda: None, bench.now)
    bench.ask(unit=2)
    assert bench.written == [READ_FRAME] * 3
    bench.pass_time(0.2)
    bench.plug()
    bench.pass_time(0.1)
    assert bench.written[3:] == [frame(2, READ)]
    assert bench.devices[1].is_resting(bench.now)
    assert not must_renew(bench)


def test_without_one_it_fails(bench: Bench) -> None:
    bench.line.renew(bench.now)
    bench.ask()
    bench.pass_time(LIMIT - 1e-6)
    assert bench.client.answers == []
    bench.pass_time(2e-6)
    assert bench.client.answers == ["83 0A"]
    bench.unplug()
    bench.ask()
    assert bench.client.answers == ["83 0A"] * 2


@pytest.mark.parametrize("how", ["port_down", "finish"])
def test_who_has_no_port_any_more_needs_no_new_connection(bench: Bench, how: str) -> None:
    time_out(bench)
    getattr(bench.line, how)(bench.now)
    bench.pass_time(WINDOW)
    assert not must_renew(bench)
    assert bench.line.deadline() is None


def test_a_line_that_ends_meanwhile_fails_what_waits(bench: Bench) -> None:
    bench.line.renew(bench.now)
    bench.ask()
    bench.line.finish(bench.now)
    bench.ask()
    assert bench.client.answers == ["83 0A"] * 2


# --- what has not arrived ---


def test_what_comes_before_the_request_has_arrived_is_no_answer_to_it(bench: Bench) -> None:
    bench.ask()
    bench.arrives = False
    bench.respond("03 02 DE AD")
    assert bench.client.answers == []
    bench.arrives = True
    bench.pass_time(0.05)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_and_without_another_one_it_is_counted_and_nobody_is_told_to_change_the_wire(bench: Bench) -> None:
    for unit in range(1, 6):
        bench.ask(unit=unit)
        bench.arrives = False
        bench.respond("03 02 DE AD", unit)
        bench.arrives = True
        bench.pass_time(TIME_OUT)
        bench.line.port_down(bench.now)
        bench.plug()
        bench.pass_time(0.1)
    assert bench.client.answers == ["83 0B"] * 5
    assert bench.counts.early_responses == 5
    assert not bench.told(AnswerTooEarly)


def test_an_answer_to_another_client_is_told_from_ours_by_that(bench: Bench) -> None:
    """Another client has asked the unit, and is answered while our request is on its way."""
    bench.hear(frame(1, READ))
    bench.pass_time(0.01)
    bench.ask()
    bench.arrives = False
    bench.respond()
    bench.arrives = True
    bench.pass_time(0.05)
    bench.hear(RESPONSE_FRAME)
    assert bench.client.answers == [RESPONSE]


def test_a_request_that_arrives_after_its_window_is_awaited_for_another_one(bench: Bench) -> None:
    bench.arrives = False
    time_out(bench)
    bench.pass_time(WINDOW)
    assert not must_renew(bench)
    bench.arrives = True
    bench.ask(client=(late := Asker("10.0.0.8:1")))
    assert late.answers == ["83 0B"]
    bench.pass_time(LIMIT)
    bench.respond("03 02 DE AD")
    assert bench.counts.late_responses == 1
    bench.pass_time(0.1)
    assert bench.asks() == "83 0B"
    assert bench.client.answers == ["83 0B"] * 2


def test_a_request_that_never_arrives_is_not_asked_again_until_it_has(bench: Bench) -> None:
    bench.arrives = False
    time_out(bench)
    for _ in range(20):
        bench.pass_time(LIMIT)
        bench.ask()
    assert bench.written == [READ_FRAME]
    assert set(bench.client.answers) <= {"83 0B", "83 06"}
    bench.arrives = True
    bench.pass_time(3 * (LIMIT + WINDOW))
    assert must_renew(bench)
