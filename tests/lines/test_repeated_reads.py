"""A read that nobody has answered is sent again once no answer to it can come any more: `retries`, `retry_within`."""

from dataclasses import replace

import pytest

from gateway.events import LateResponse, RequestTimeout, UnitRecovered, UnitResting
from gateway.lines.breaker import FAILURES
from kit.asker import Asker
from kit.line_bench import ASCII, LATENCY, LIMIT, READ, REQUEST_TIME, RESPONSE, TIMING, Bench, is_empty

OTHER = "03 00 20 00 01"
WRITE = "06 00 01 00 05"
WINDOW = 2 * LIMIT
#: From the first sending until the late window of READ is over.
OVER = REQUEST_TIME + LIMIT + WINDOW


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param, retries=1)


def sent(bench: Bench, pdu: str = READ, unit: int = 1) -> int:
    """How often this was sent."""
    return bench.written.count(bench.frame(unit, pdu))


def until_sent_again(bench: Bench, times: int = 2) -> float:
    """Let time pass until READ was sent so often; how long that took."""
    begin = bench.now
    while sent(bench) < times:
        bench.pass_time(0.001)
        assert bench.now < begin + 5.0
    return bench.now - begin


def test_when_its_late_window_is_over(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(LIMIT + WINDOW - 0.05)
    assert (sent(bench), bench.client.answers) == (1, [])
    until_sent_again(bench)
    assert bench.line.ledger.count_late(bench.now) == 0
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    counts = bench.counts
    assert (counts.sent, counts.retries, counts.ok, counts.timeout) == (2, 1, 1, 0)
    assert bench.events == []


def test_when_the_late_answer_has_come(bench: Bench) -> None:
    """Which is dropped: a newer one is asked for."""
    bench.ask()
    bench.pass_time(0.25)
    bench.respond("03 02 DE AD")
    bench.pass_time(0.01)
    assert sent(bench) == 2
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert [type(event) for event in bench.events] == [LateResponse]


def test_so_many_times_and_no_more(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(5.0)
    assert sent(bench) == 2
    assert bench.client.answers == ["83 0B"]
    assert len(bench.told(RequestTimeout)) == 1
    assert is_empty(bench.line)


@pytest.mark.parametrize("pdu", [WRITE, "41 01", "17 00 01 00 01 00 64 00 01 02 00 00"])
def test_no_write(bench: Bench, pdu: str) -> None:
    bench.ask(pdu)
    bench.pass_time(5.0)
    assert sent(bench, pdu) == 1


def test_not_for_a_client_that_has_left(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.client.gone = True
    bench.pass_time(5.0)
    assert sent(bench) == 1
    assert is_empty(bench.line)
    assert bench.client.answers == ["83 0B"]
    assert (bench.counts.timeout, bench.counts.unwanted) == (1, 0)


def test_nor_if_others_take_its_place_in_a_full_queue(bench: Bench) -> None:
    """It was sent once, so it fails as that does: 06 would say that nothing was sent."""
    bench = Bench(timing=bench.settings.timing, retries=1, queue=1)
    bench.ask()
    bench.pass_time(0.3)
    bench.client.gone = True
    for client in (Asker("10.0.0.10:1"), Asker("10.0.0.11:1")):
        bench.ask(WRITE, 2, client)
    assert bench.client.answers == ["83 0B"]
    assert (bench.counts.timeout, bench.counts.unwanted) == (1, 0)


def test_meanwhile_the_line_goes_on(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.25)
    other = Asker("10.0.0.10:1")
    for unit, pdu in ((2, READ), (1, WRITE)):
        bench.ask(pdu, unit, client=other)
        bench.pass_time(0.02)
        bench.respond(RESPONSE if pdu is READ else WRITE, unit)
        bench.pass_time(0.01)
    assert other.answers == [RESPONSE, WRITE]
    assert sent(bench) == 1


def test_what_the_same_client_asks_of_the_unit_meanwhile_keeps_its_order(bench: Bench) -> None:
    bench.ask()
    bench.ask(WRITE)
    bench.pass_time(0.4)
    assert sent(bench, WRITE) == 0
    until_sent_again(bench)
    bench.respond()
    bench.pass_time(0.01)
    bench.respond(WRITE)
    assert bench.client.answers == [RESPONSE, WRITE]


def test_max_wait_is_for_the_queue_only() -> None:
    bench = Bench(retries=1, max_wait=0.3)
    bench.ask()
    until_sent_again(bench)
    bench.respond()
    assert bench.client.answers == [RESPONSE]


def test_who_shares_it_gets_its_answer(bench: Bench) -> None:
    bench.ask(unit=2)
    first, second = Asker("10.0.0.10:1"), Asker("10.0.0.11:1")
    bench.ask(client=first)
    bench.ask(client=second)
    bench.pass_time(0.02)
    bench.respond(unit=2)
    until_sent_again(bench)
    bench.respond()
    assert (first.answers, second.answers) == ([RESPONSE], [RESPONSE])


# --- a unit that rests ---


def fails(bench: Bench, times: int) -> None:
    """So many reads fail, each with its repeat; the rest of the unit, if there is one, is over."""
    for _ in range(times):
        bench.ask()
        bench.pass_time(70.0)
    assert bench.client.answers == ["83 0B"] * times
    bench.client.answers.clear()
    bench.written.clear()


def test_with_its_repeats_a_read_is_one_failure() -> None:
    bench = Bench(retries=FAILURES, retry_within=10.0)
    fails(bench, FAILURES - 1)
    assert bench.told(UnitResting) == []
    bench.ask()
    bench.pass_time(0.3)
    assert len(bench.told(UnitResting)) == 1
    until_sent_again(bench, 1 + FAILURES)
    assert len(bench.told(UnitResting)) == 1


def test_a_unit_that_needs_a_second_request_is_reached_after_it_has_rested(bench: Bench) -> None:
    """A device that sleeps is awake only for a moment after each request. The probe is one read with its repeats."""
    fails(bench, FAILURES)
    assert len(bench.told(UnitResting)) == 1
    for number in range(1, 13):
        bench.ask()
        until_sent_again(bench, 2 * number)
        bench.respond()
        bench.pass_time(60.0)
    assert bench.client.answers == [RESPONSE] * 12
    assert len(bench.told(UnitRecovered)) == 1


def test_meanwhile_others_of_the_unit_get_0b_at_once(bench: Bench) -> None:
    fails(bench, FAILURES)
    bench.ask()
    bench.pass_time(0.3)
    other = Asker("10.0.0.10:1")
    bench.ask(OTHER, client=other)
    bench.ask("04 00 10 00 01", client=other)
    assert other.answers == ["83 0B", "84 0B"]


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_a_unit_that_does_not_answer_takes_a_tenth_of_the_line_with_repeats_too(retries: int) -> None:
    bench = Bench(retries=retries, retry_within=10.0)
    fails(bench, FAILURES)
    bench.pass_time(1000.0)
    begin, stop = bench.now, bench.now + 3600.0
    while bench.now < stop:
        bench.ask()
        bench.pass_time(0.1)
    busy = (REQUEST_TIME + LIMIT) * sent(bench)
    assert busy / (bench.now - begin) <= 0.1


def test_a_rest_is_nine_limits_for_each_time_the_read_was_sent() -> None:
    bench = Bench(retries=1, rest=1000.0)
    bench.device(1, timeout=2.0)
    limit = 2.0 + LIMIT - 0.2
    for _ in range(FAILURES):
        bench.pass_time(20.0)
        bench.ask()
        bench.pass_time(2 * (REQUEST_TIME + limit) + 2 * limit + 0.01)
    left = bench.devices[1].breaker.rest_left(bench.now)
    assert left == pytest.approx(2 * limit + 18 * limit, abs=0.02)


def test_a_unit_whose_clients_leave_before_the_repeat_rests_too(bench: Bench) -> None:
    for number in range(FAILURES):
        client = Asker(f"10.0.0.10:{number}")
        bench.ask(client=client)
        bench.pass_time(0.3)
        client.gone = True
        bench.pass_time(1.0)
    assert sent(bench) == FAILURES
    assert len(bench.told(UnitResting)) == 1


def test_a_repeat_that_fails_after_another_request_was_answered_counts(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.ask("04 00 10 00 01", client=Asker("10.0.0.10:1"))
    bench.pass_time(0.02)
    bench.respond("04 02 00 07")
    assert bench.devices[1].breaker.failures == 0
    bench.pass_time(5.0)
    assert (sent(bench), bench.devices[1].breaker.failures) == (2, 1)


# --- by when ---


def test_it_ends_within_two_limits_and_windows_of_its_first_sending(bench: Bench) -> None:
    bench = Bench(timing=bench.settings.timing, retries=5)
    begin = bench.now
    bench.ask()
    while not bench.client.answers:
        bench.pass_time(0.001)
    character = bench.settings.timing.character
    assert sent(bench) == 2
    assert bench.now - begin < 2 * (LIMIT + WINDOW) + 60 * character


@pytest.mark.parametrize("within", [0.9, 0.8])
def test_retry_within(within: float) -> None:
    """Sent again at 0.63 s, it fails at 0.85 s."""
    bench = Bench(retries=1, retry_within=within)
    bench.ask()
    bench.pass_time(0.3)
    assert bench.client.answers == ([] if within == 0.9 else ["83 0B"])
    bench.pass_time(0.6)
    assert sent(bench) == (2 if within == 0.9 else 1)
    assert bench.client.answers == ["83 0B"]


def test_a_read_that_comes_to_its_turn_too_late_is_0b_in_time() -> None:
    """The line is taken by a slow device when it could be sent again."""
    bench = Bench(retries=1, retry_within=0.9)
    bench.device(2, timeout=2.0)
    bench.ask()
    bench.pass_time(OVER - 0.05)
    bench.ask(unit=2, client=Asker("10.0.0.10:1"))
    bench.pass_time(0.9 - OVER)
    assert bench.client.answers == ["83 0B"]
    assert sent(bench) == 1


def test_a_broken_answer_is_not_repeated_when_that_would_end_too_late() -> None:
    bench = Bench(retries=1, retry_within=0.3)
    bench.ask()
    bench.hear("55")
    bench.pass_time(1.0)
    assert sent(bench) == 1
    assert bench.client.answers == ["83 0B"]


@pytest.mark.parametrize(("baud", "late_window"), [(1200, 0.1), (2400, 0.05), (9600, 0.015), (19200, 0.01)])
@pytest.mark.parametrize("is_busy", [False, True])
def test_there_is_always_time_for_one_repeat(baud: int, late_window: float, is_busy: bool) -> None:
    """Where the request takes longer than the late window too, and when others ask."""
    timing = replace(TIMING, baud=baud)
    bench = Bench(timing=timing, late_window=late_window, retries=1)
    bench.ask()
    if is_busy:
        bench.pass_time(8 * timing.character + 0.2 + 7 * timing.character + LATENCY + late_window - 0.001)
        bench.ask("05 00 00 FF 00", 2, Asker("10.0.0.10:1"))
        bench.pass_time(16 * timing.character + 0.002)
        bench.respond("05 00 00 FF 00", 2)
    bench.pass_time(2.0)
    assert (sent(bench), bench.counts.retries) == (2, 1)


# --- what may happen meanwhile ---


def test_a_lost_port_is_0b_for_what_was_sent(bench: Bench) -> None:
    bench.ask()
    bench.ask(WRITE)
    bench.pass_time(0.3)
    bench.unplug()
    assert bench.client.answers == ["83 0B", "86 0A"]
    assert is_empty(bench.line)


def test_a_line_that_finishes_sends_it_no_more(bench: Bench) -> None:
    bench.ask()
    bench.pass_time(0.3)
    bench.line.finish(bench.now)
    assert bench.client.answers == ["83 0B"]
    bench.pass_time(2.0)
    assert sent(bench) == 1
