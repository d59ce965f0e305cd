"""What is counted for a unit: each request once, under what became of it."""

from dataclasses import astuple

import pytest

from gateway import errors
from gateway.lines.counts import OTHER_FUNCTIONS, RESULTS, Counts, UnitCounts, total
from gateway.profiles.profile import Profile
from gateway.timing.measured import NEVER
from kit.asker import Asker
from kit.line_bench import LIMIT, READ, REQUEST_TIME, RESPONSE, RESPONSE_FRAME, SETTINGS, Bench

WRITE = "06 00 01 00 05"
#: What the line itself never answers.
ELSEWHERE = {"denied", "no_route", "stale", "only_heard"}


def results(bench: Bench) -> dict[str, int]:
    """What has become of requests, as often as it has."""
    counts = bench.counts
    return {name: count for name in RESULTS if (count := getattr(counts, name))}


@pytest.fixture
def bench() -> Bench:
    return Bench()


def below(error: type) -> list[type]:
    return [one for sub in error.__subclasses__() for one in (sub, *below(sub))]


def test_each_error_of_a_request_has_a_place_of_its_own_among_the_results() -> None:
    names = {error.result for error in below(errors.RequestError) if error.__module__ == errors.__name__}
    assert names - ELSEWHERE == set(RESULTS) - {"ok", "exception", "broadcast"}


def test_counts_go_by_function_and_those_that_are_not_known_share_one() -> None:
    counts = UnitCounts()
    for function in (3, 3, 65, 100, 0, 200):
        counts[function].ok += 1
    assert {function: one.ok for function, one in counts.items()} == {3: 2, OTHER_FUNCTIONS: 4}


def test_a_total() -> None:
    assert total([]) == Counts()
    assert total([Counts(ok=1, sent=2), Counts(ok=3, noise=4)]) == Counts(ok=4, sent=2, noise=4)


def test_an_answer(bench: Bench) -> None:
    assert bench.asks() is not None
    bench.pass_time(2.0)
    bench.ask()
    bench.hear(RESPONSE_FRAME)
    assert results(bench) == {"timeout": 1, "ok": 1}
    assert bench.devices[1].counts[3].responses == 1


def test_an_exception_of_the_unit_with_its_code(bench: Bench) -> None:
    for code in ("83 02", "83 04", "83 02"):
        bench.ask()
        bench.respond(code)
        bench.pass_time(0.01)
    assert results(bench) == {"exception": 3}
    assert bench.devices[1].counts.codes == {2: 2, 4: 1}
    assert bench.devices[1].counts.last_error == "exception 02"


def test_what_was_sent_and_failed_is_the_units_last_error(bench: Bench) -> None:
    bench.device(timeout=0.2)
    counts = bench.devices[1].counts
    assert counts.last_error == ""
    bench.asks()
    assert counts.last_error == "timeout"
    bench.ask()
    bench.hear("01 03 02 01 10 00 00")
    bench.pass_time(1.0)
    assert counts.last_error == "bad_frame"
    bench.ask()
    bench.respond("03 00 30 00 01")
    bench.respond()
    assert counts.last_error == "ambiguous"
    bench.pass_time(1.0)
    bench.ask()
    bench.unplug()
    assert counts.last_error == "line_lost"
    bench.ask()
    assert counts.last_error == "line_lost"
    assert results(bench) == {"timeout": 1, "bad_frame": 1, "ambiguous": 1, "line_lost": 1, "line_down": 1}


def test_what_the_profile_refuses(bench: Bench) -> None:
    bench.device(profile=Profile("mint", functions=frozenset({3})))
    bench.ask("04 00 10 00 01")
    bench.ask("03 00 10 00 00")
    bench.ask("41")
    assert results(bench) == {"refused": 3}
    assert set(bench.devices[1].counts) == {3, 4, OTHER_FUNCTIONS}


def test_what_is_refused_while_a_late_answer_is_awaited_or_the_unit_rests(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(LIMIT + 0.01)
    bench.ask()
    assert results(bench) == {"timeout": 1, "overdue": 1}
    bench.pass_time(1.0)
    bench.asks()
    bench.asks()
    bench.ask()
    assert results(bench) == {"timeout": 3, "overdue": 1, "resting": 1}


def test_each_request_that_shares_a_read_counts_and_the_transaction_once(bench: Bench) -> None:
    bench.ask(WRITE, unit=2)
    for number in range(3):
        bench.ask(client=Asker(f"10.0.0.{number}:1"))
    bench.respond(WRITE, unit=2)
    bench.pass_time(0.01)
    bench.respond(RESPONSE)
    counts = bench.devices[1].counts[3]
    assert counts == Counts(ok=3, sent=1, responses=1, coalesced=2)


def test_a_request_whose_client_has_left(bench: Bench) -> None:
    gone = Asker("10.0.0.1:1")
    bench.ask(unit=2)
    bench.ask(READ, client=gone)
    gone.gone = True
    bench.respond(unit=2)
    bench.pass_time(0.01)
    assert results(bench) == {"ok": 1, "unwanted": 1}


def test_a_request_whose_client_has_left_makes_room_in_a_full_queue() -> None:
    bench = Bench(queue=1)
    gone = Asker("10.0.0.1:1")
    bench.ask(unit=2)
    bench.ask(client=gone)
    gone.gone = True
    bench.ask(client=Asker("10.0.0.2:1"))
    bench.ask(client=Asker("10.0.0.3:1"), pdu=WRITE)
    assert results(bench) == {"unwanted": 1, "queue_full": 1}


def test_how_long_a_line_was_busy(bench: Bench) -> None:
    character = bench.settings.timing.character
    bench.ask()
    bench.pass_time(0.05)
    request, response, gap = 8 * character, 7 * character, 3.5 * character
    assert astuple(bench.line.phases(bench.now)) == pytest.approx((request, 0.05 - request, 0, 0))
    bench.respond()
    bench.pass_time(10.0)
    after = (request, 0.05 - request - response, response, gap)
    assert astuple(bench.line.phases(bench.now)) == pytest.approx(after)
    bench.broadcast(WRITE)
    bench.pass_time(10.0)
    assert bench.line.phases(bench.now).busy == pytest.approx(sum(after) + 8 * character + 0.1)


def test_the_time_of_a_request_that_fails_is_spent_waiting_and_its_repetition_too() -> None:
    bench = Bench(retries=1)
    bench.asks()
    bench.pass_time(10.0)
    request = 8 * bench.settings.timing.character
    assert bench.counts.sent == 2
    assert astuple(bench.line.phases(bench.now)) == pytest.approx((2 * request, 2 * LIMIT, 0, 0))


def test_times_of_a_unit_by_function(bench: Bench) -> None:
    """A read is sent at once and answered 20 ms after its last character; a write waits behind it."""
    bench.ask()
    bench.ask(WRITE)
    bench.pass_time(REQUEST_TIME + 0.02)
    bench.respond()
    bench.pass_time(0.0021)
    bench.pass_time(REQUEST_TIME + 0.1)
    bench.respond(WRITE)
    read, write = bench.devices[1].counts.times[3], bench.devices[1].counts.times[6]
    assert (read.wait.total, read.answer.total) == pytest.approx((0, 0.02))
    assert read.share.total == pytest.approx(0.02 / LIMIT)
    assert read.request.total == pytest.approx(REQUEST_TIME + 0.02)
    assert write.wait.total == pytest.approx(REQUEST_TIME + 0.02 + 3.5 * bench.settings.timing.character, abs=1e-5)
    assert write.request.total == pytest.approx(write.wait.total + REQUEST_TIME + 0.1, abs=2e-4)
    assert [sum(one.counts) for one in (read.wait, read.answer, read.share, read.request)] == [1, 1, 1, 1]
    assert read.limit == pytest.approx(LIMIT)


def test_what_fails_after_it_was_sent_has_taken_its_time_and_has_no_time_of_an_answer(bench: Bench) -> None:
    bench.asks()
    times = bench.devices[1].counts.times[3]
    assert times.request.total == pytest.approx(REQUEST_TIME + LIMIT)
    assert sum(times.answer.counts) == 0
    assert times.limit == pytest.approx(LIMIT)


def test_what_was_refused_before_it_was_sent_took_no_time(bench: Bench) -> None:
    bench.unplug()
    bench.ask()
    times = bench.devices[1].counts.times[3]
    assert sum(times.request.counts) == sum(times.wait.counts) == 0


def test_each_request_that_shares_a_read_has_waited_and_the_repetition_waits_no_more() -> None:
    bench = Bench(retries=1)
    bench.ask(unit=2)
    for number in range(3):
        bench.ask(client=Asker(f"10.0.0.{number}:1"))
    bench.respond(unit=2)
    bench.pass_time(10.0)
    counts = bench.devices[1].counts
    assert (counts[3].sent, sum(counts.times[3].wait.counts), sum(counts.times[3].request.counts)) == (2, 3, 3)


def test_functions_that_are_not_known_share_their_times() -> None:
    counts = UnitCounts()
    for function in (65, 100, 3):
        counts[function].ok += 1
    assert counts.times[65] is counts.times[100] is counts.times[OTHER_FUNCTIONS] is not counts.times[3]


def test_when_the_last_answer_and_the_last_error_came(bench: Bench) -> None:
    bench.device()
    counts = bench.devices[1].counts
    assert (counts.times, counts.last_error_at) == ({}, NEVER)
    bench.ask()
    bench.respond()
    answered_at = bench.now
    bench.pass_time(1.0)
    bench.asks()
    assert counts.times[3].answered_at == answered_at
    assert counts.last_error_at == pytest.approx(answered_at + 1.0 + REQUEST_TIME + LIMIT)
    bench.ask()
    bench.respond("83 02")
    assert (counts.times[3].answered_at, counts.last_error_at) == (bench.now, bench.now)


def test_a_transaction_takes_its_line_until_the_next_one_may_be_sent():
    bench = Bench()
    bench.ask()
    bench.pass_time(REQUEST_TIME + 0.02)
    bench.respond()
    ((user, use),) = bench.line.spent.usage.look().items()
    assert user == ("127.0.0.1", 1, 3)
    assert use.seconds == pytest.approx(REQUEST_TIME + 0.02 + SETTINGS.silence_before_request)


def test_a_client_without_an_address_goes_by_its_name_and_a_broadcast_takes_its_turnaround():
    bench = Bench()
    bench.broadcast("06 00 01 00 05", Asker("control", host=""))
    ((user, use),) = bench.line.spent.usage.look().items()
    assert user == ("control", 0, 6)
    assert use.seconds == pytest.approx(REQUEST_TIME + SETTINGS.turnaround)
