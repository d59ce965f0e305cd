"""What a line counts of frames that are no answers, so that an echo, another client or a double address can be told."""

import pytest

from kit.line_bench import ASCII, READ, RESPONSE, TIMING, Bench

OTHER_READ = "03 00 30 00 01"


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param)


def test_a_copy_of_the_request_is_counted_on_any_port(bench: Bench) -> None:
    bench.ask()
    bench.respond(READ)
    bench.pass_time(0.01)
    bench.respond()
    assert (bench.line.attribution.overheard.copies, bench.line.attribution.overheard.requests) == (1, 0)


def test_a_copy_that_the_adapter_makes_is_counted() -> None:
    bench = Bench(virtual=False)
    bench.ask()
    bench.pass_time(0.002)
    bench.respond(READ)
    assert (bench.line.attribution.overheard.copies, bench.line.attribution.overheard.requests) == (1, 0)


def test_requests_of_another_client_are_counted_also_while_nothing_is_asked(bench: Bench) -> None:
    for _ in range(3):
        bench.respond(OTHER_READ, unit=2)
        bench.pass_time(1.0)
        bench.respond(RESPONSE, unit=2)
        bench.pass_time(1.0)
    assert (bench.line.attribution.overheard.copies, bench.line.attribution.overheard.requests) == (0, 3)


def test_who_asks_something_else_behind_our_request_is_another_client(bench: Bench) -> None:
    bench.ask()
    bench.respond()
    bench.pass_time(1.0)
    bench.respond(OTHER_READ)
    assert (bench.line.attribution.overheard.copies, bench.line.attribution.overheard.requests) == (0, 1)


def test_an_answer_that_comes_once_more_is_counted_for_its_unit(bench: Bench) -> None:
    for _ in range(2):
        bench.ask()
        bench.pass_time(0.02)
        bench.respond()
        bench.pass_time(0.02)
        bench.respond("03 02 00 07")
        bench.pass_time(1.0)
    assert bench.client.answers == [RESPONSE, RESPONSE]
    assert bench.line.attribution.overheard.second_responses == {1: 2}


def test_answers_that_come_once_leave_no_trace(bench: Bench) -> None:
    for _ in range(3):
        bench.ask()
        bench.pass_time(0.02)
        bench.respond()
        bench.pass_time(1.0)
    overheard = bench.line.attribution.overheard
    assert (overheard.copies, overheard.requests, overheard.second_responses) == (0, 0, {})


def test_an_answer_that_comes_after_its_late_window_is_counted(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(30.0)
    bench.respond()
    assert bench.counts.late_responses == 0
    belated = bench.line.attribution.overheard.belated[1]
    assert belated.count == 1
    assert 29.9 < belated.longest < 30.0
    assert belated.limit == bench.devices[1].counts.times[3].limit


def test_a_response_before_its_request_was_sent_is_not_counted_as_late() -> None:
    bench = Bench(virtual=False)
    bench.ask()
    bench.pass_time(0.001)
    bench.respond()
    bench.pass_time(2.0)
    assert bench.line.attribution.overheard.belated == {}
    assert bench.line.attribution.overheard.second_responses == {}


def test_how_long_the_slowest_late_answer_took_is_kept(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.4)
    bench.respond()
    bench.pass_time(2.0)
    (times,) = bench.devices[1].counts.times.values()
    assert 0.35 < times.latest < 0.4
    assert times.late == 1
    bench.asks()
    assert times.latest > 0.35


def test_what_came_in_place_of_an_answer_is_kept(bench: Bench) -> None:
    for number in range(10):
        bench.ask()
        bench.pass_time(0.02)
        bench.hear(f"55 AA {number:02X}")
        bench.pass_time(200.0)
    instead = bench.devices[1].counts.received_instead
    assert [text[2] for text in instead] == [*range(2, 10)]


def test_when_copies_and_requests_of_others_were_heard_last_and_how_many_requests_were_sent_since(bench: Bench) -> None:
    bench.ask()
    bench.respond(READ)
    bench.pass_time(0.01)
    copied_at = bench.now
    bench.respond()
    bench.pass_time(1.0)
    bench.respond(OTHER_READ, unit=2)
    bench.pass_time(1.0)
    bench.ask()
    overheard = bench.line.attribution.overheard
    assert (overheard.sent_since_copy, overheard.sent_since_request) == (1, 1)
    assert overheard.copied_at <= copied_at < overheard.requested_at < bench.now
