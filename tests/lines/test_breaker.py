"""Resting units: a device that does not answer takes little of its line's time, and comes back by itself."""

import pytest

from gateway.events import UnitRecovered, UnitResting
from gateway.lines.breaker import FAILURES, Breaker
from gateway.timing.characters import LineTiming
from kit.asker import Asker
from kit.line_bench import ASCII, LATENCY, LIMIT, READ, REQUEST_TIME, RESPONSE, TIMING, Bench, frame, is_empty

OTHER_FUNCTION = "04 00 10 00 01"
#: Long enough for the window after a time-out, and for the first rest behind that (nine limits are more than 1 s).
WINDOW = 2 * LIMIT
REST = 9 * LIMIT


def failing(*limits: float, window: float = 0.0, longest: float | None = None) -> list[float]:
    """How long the rests after failures with these limits are, each failure when the rest before it has ended."""
    breaker, now, rests = Breaker(), 0.0, []
    for limit in limits:
        breaker.record_failure(limit, now + window, longest)
        rests.append(breaker.rest)
        now += window + breaker.rest
        assert not breaker.is_resting(now)
    return rests


def test_the_third_failure_in_a_row_begins_a_rest() -> None:
    breaker = Breaker()
    assert [breaker.record_failure(0.05, 10.0) for _ in range(FAILURES)] == [False, False, True]
    assert breaker.is_resting(10.0 + 1.0 - 0.001)
    assert breaker.rest_left(10.0) == pytest.approx(1.0)
    assert not breaker.is_resting(10.0 + 1.0)
    assert breaker.rest_left(10.0 + 1.0) == 0.0


def test_a_rest_lasts_a_second_or_nine_limits_and_doubles_to_a_minute() -> None:
    assert failing(*[0.05] * 10)[2:] == [1, 2, 4, 8, 16, 32, 60, 60]
    assert failing(*[1.0] * 7)[2:] == [9, 18, 36, 60, 60]


def test_nine_limits_may_be_more_than_a_minute() -> None:
    assert failing(*[10.0] * 5)[2:] == [90, 90, 90]


def test_a_rest_is_never_less_than_nine_limits_of_the_request_that_failed() -> None:
    assert failing(0.05, 0.05, 0.05, 2.0)[2:] == [1, 18]


def test_the_longest_rest_can_be_set_shorter_and_longer() -> None:
    assert failing(*[0.05] * 6, longest=3.0)[2:] == [1, 2, 3, 3]
    assert failing(*[1.0] * 4, longest=0.5)[2:] == [0.5, 0.5]
    assert failing(*[0.05] * 10, longest=100.0)[-2:] == [64, 100]


def test_without_rests_no_failure_begins_one() -> None:
    breaker = Breaker()
    assert not any(breaker.record_failure(1.0, 0.0, 0.0) for _ in range(10))
    assert (breaker.failures, breaker.rest, breaker.is_resting(0.0)) == (10, 0.0, False)
    assert not breaker.record_success()


def test_a_rest_counts_from_the_end_of_the_late_window() -> None:
    breaker = Breaker()
    for _ in range(FAILURES):
        breaker.record_failure(0.05, 7.0)
    assert breaker.is_resting(7.999)
    assert not breaker.is_resting(8.0)


def test_each_rest_is_news_and_the_end_of_the_last() -> None:
    breaker = Breaker()
    assert [breaker.record_failure(0.05, 0.0) for _ in range(FAILURES + 3)].count(True) == 4
    assert breaker.record_success()
    assert not breaker.record_success()
    assert (breaker.failures, breaker.rest, breaker.is_resting(0.0)) == (0, 0.0, False)


def test_a_frame_before_the_third_failure_ends_the_row() -> None:
    breaker = Breaker()
    breaker.record_failure(0.05, 0.0)
    breaker.record_failure(0.05, 0.0)
    assert not breaker.record_success()
    assert not breaker.record_failure(0.05, 0.0)


# --- on a line ---


@pytest.fixture
def bench() -> Bench:
    return Bench()


def fail(bench: Bench, times: int = FAILURES, unit: int = 1) -> None:
    """So many requests fail; the last one's window begins now, and the rest behind it."""
    for number in range(times):
        if number:
            bench.pass_time(WINDOW + 0.001)
        count = len(bench.client.answers)
        bench.ask(unit=unit)
        while len(bench.client.answers) == count:
            bench.pass_time(bench.line.deadline() - bench.now)
    bench.written.clear()
    bench.client.answers.clear()


def test_a_unit_that_rests_gets_0b_at_once_whatever_the_function(bench: Bench) -> None:
    fail(bench)
    bench.ask(OTHER_FUNCTION)
    assert bench.client.answers == ["84 0B"]
    assert bench.written == []
    assert bench.counts.resting == 1
    event = bench.told(UnitResting)[0]
    assert (event.unit, event.device, event.rest_s) == (1, "unit-1", round(WINDOW + REST, 1))


def test_a_line_can_be_told_how_long_rests_are_and_that_there_are_none() -> None:
    bench = Bench(rest=0.5)
    fail(bench)
    bench.pass_time(WINDOW + 0.5 + 0.001)
    fail(bench, 1)
    assert [event.rest_s for event in bench.told(UnitResting)] == [round(WINDOW + 0.5, 1)] * 2
    bench = Bench(rest=0.0)
    fail(bench, 10)
    assert bench.told(UnitResting) == []
    assert not bench.devices[1].is_resting(bench.now)


def test_other_units_do_not_notice(bench: Bench) -> None:
    fail(bench)
    bench.ask(unit=2)
    bench.respond(unit=2)
    assert bench.client.answers == [RESPONSE]


def test_when_the_rest_is_over_the_next_request_is_the_probe_and_nothing_is_sent_before(bench: Bench) -> None:
    fail(bench)
    bench.pass_time(WINDOW + REST - 0.001)
    bench.ask()
    assert (bench.client.answers, bench.written) == (["83 0B"], [])
    bench.pass_time(60)
    assert bench.written == []
    bench.ask()
    assert bench.written == [bench.frame(1, READ)]


def test_there_is_one_probe_at_a_time_and_what_waits_behind_it_shares_its_fate(bench: Bench) -> None:
    fail(bench)
    bench.pass_time(WINDOW + REST + 0.001)
    bench.ask()
    bench.ask(OTHER_FUNCTION)
    bench.ask(unit=2)
    bench.pass_time(0.22)
    assert sorted(bench.client.answers) == ["83 0B", "84 0B"]
    assert bench.written == [bench.frame(1, READ), bench.frame(2, READ)]
    rests = [round(WINDOW + REST, 1), round(WINDOW + 2 * REST, 1)]
    assert [event.rest_s for event in bench.told(UnitResting)] == rests


def test_an_answer_to_the_probe_ends_the_rests(bench: Bench) -> None:
    fail(bench)
    bench.pass_time(WINDOW + REST + 0.001)
    bench.ask()
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert bench.told(UnitRecovered) == [UnitRecovered("hall-a", 1, "unit-1")]
    fail(bench, FAILURES - 1)
    assert not bench.devices[1].breaker.is_resting(bench.now)
    assert len(bench.told(UnitRecovered)) == 1


def test_a_late_response_ends_a_rest(bench: Bench) -> None:
    fail(bench)
    bench.respond()
    bench.ask(OTHER_FUNCTION)
    bench.pass_time(0.01)
    assert len(bench.written) == 1
    assert len(bench.told(UnitRecovered)) == 1


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
@pytest.mark.parametrize("pdu", [RESPONSE, "84 02", "41 01 02"])
def test_a_frame_that_nobody_awaits_any_more_ends_a_rest(timing: LineTiming, pdu: str) -> None:
    """It may come in pieces, behind noise."""
    bench = Bench(timing=timing)
    fail(bench)
    bench.pass_time(WINDOW + 1.0)
    answer = "55 01 " + bench.frame(1, pdu)
    bench.hear(answer[:12])
    assert bench.devices[1].breaker.is_resting(bench.now)
    bench.pass_time(0.02)
    bench.hear(answer[12:])
    bench.pass_time(0.02)
    assert bench.told(UnitRecovered) == [UnitRecovered("hall-a", 1, "unit-1")]
    bench.ask()
    assert bench.written == [bench.frame(1, READ)]


@pytest.mark.parametrize("timing", [TIMING, ASCII], ids=["rtu", "ascii"])
@pytest.mark.parametrize(
    ("unit", "pdu"),
    [
        pytest.param(2, RESPONSE, id="another unit"),
        pytest.param(1, READ, id="another client asks the unit"),
        pytest.param(1, "06 00 01 00 05", id="either of the two"),
        pytest.param(1, "03 00 10 00 00", id="neither of the two"),
    ],
)
def test_a_frame_that_the_unit_may_not_have_sent_ends_no_rest(timing: LineTiming, unit: int, pdu: str) -> None:
    bench = Bench(timing=timing)
    fail(bench)
    bench.pass_time(WINDOW + 1.0)
    bench.respond(pdu, unit)
    assert bench.devices[1].breaker.is_resting(bench.now)


@pytest.mark.parametrize("behind", ["", "55"])
def test_silence_ends_a_frame_of_unknown_size(bench: Bench, behind: str) -> None:
    fail(bench)
    bench.pass_time(WINDOW + 1.0)
    bench.hear("55 " + bench.frame(1, "41 01 02 03"))
    bench.pass_time(TIMING.silence(3.5))  # that of the line; the port may have held back what follows
    assert bench.told(UnitRecovered) == []
    bench.hear(behind)
    bench.pass_time(TIMING.silence(3.5) + LATENCY)
    assert len(bench.told(UnitRecovered)) == (not behind)


def test_the_next_request_ends_a_frame_of_unknown_size(bench: Bench) -> None:
    """On a busy line no silence is longer."""
    fail(bench)
    bench.pass_time(WINDOW + 1.0)
    bench.respond("41 01 02 03")
    bench.ask(unit=2)
    bench.pass_time(TIMING.silence(3.5))
    assert (bench.written, len(bench.told(UnitRecovered))) == ([bench.frame(2, READ)], 1)


def test_a_broken_frame_ends_no_rest(bench: Bench) -> None:
    fail(bench)
    bench.pass_time(WINDOW + 1.0)
    bench.hear("01 03 02 01 10 B8 19")
    assert bench.devices[1].breaker.is_resting(bench.now)


def test_a_late_response_ends_the_row_of_failures(bench: Bench) -> None:
    for _ in range(2 * FAILURES):
        fail(bench, 1)
        bench.respond()
        bench.pass_time(0.01)
    assert bench.told(UnitResting) == []


def test_an_exception_ends_a_rest_and_is_no_failure(bench: Bench) -> None:
    fail(bench)
    bench.pass_time(WINDOW + REST + 0.001)
    for _ in range(FAILURES + 1):
        bench.ask()
        bench.respond("83 04")
        bench.pass_time(0.01)
    assert bench.client.answers == ["83 04"] * (FAILURES + 1)
    assert len(bench.told(UnitResting)) == 1


def test_a_reopened_port_ends_all_rests(bench: Bench) -> None:
    fail(bench)
    fail(bench, unit=2)
    bench.unplug()
    bench.plug()
    bench.pass_time(0.01)
    bench.ask(OTHER_FUNCTION)
    bench.ask(OTHER_FUNCTION, unit=2)
    assert bench.written == [bench.frame(1, OTHER_FUNCTION)]
    assert bench.client.answers == []
    assert bench.told(UnitRecovered) == []


def test_the_loss_of_the_line_is_no_failure(bench: Bench) -> None:
    for _ in range(FAILURES):
        bench.ask()
        bench.unplug()
        bench.plug()
        bench.pass_time(WINDOW + 0.01)
    assert bench.devices[1].breaker.failures == 0


def test_a_broken_frame_is_a_failure(bench: Bench) -> None:
    for _ in range(FAILURES):
        bench.ask()
        bench.hear("01 03 02 01 10 B8")
        bench.pass_time(1.0)
    assert len(bench.told(UnitResting)) == 1


def test_an_answer_with_a_wrong_check_sum_is_none(bench: Bench) -> None:
    """The unit is there, and takes no more of the line's time than with a right one."""
    for _ in range(2 * FAILURES):
        bench.ask()
        bench.hear("01 03 02 01 10 B8 19")
        bench.pass_time(1.0)
    assert bench.told(UnitResting) == []


@pytest.mark.parametrize("late", ["02 03 55 AA", "02 83 55", frame(2, RESPONSE)])
def test_when_another_units_late_answer_is_heard_it_is_no_failure(bench: Bench, late: str) -> None:
    """The two may have spoken at once."""
    for _ in range(FAILURES):
        fail(bench, 1, unit=2)
        bench.devices[2].breaker.record_success()
        bench.ask()
        bench.hear(late)
        bench.pass_time(1.0)
    assert bench.told(UnitResting) == []


def test_noise_while_another_unit_is_in_its_window_is_a_failure(bench: Bench) -> None:
    for _ in range(FAILURES):
        fail(bench, 1, unit=2)
        bench.devices[2].breaker.record_success()
        bench.ask()
        bench.hear("55 AA")
        bench.pass_time(1.0)
    assert [event.unit for event in bench.told(UnitResting)] == [1]


def test_so_is_noise_beside_a_frame_that_nobody_awaits(bench: Bench) -> None:
    for _ in range(FAILURES):
        bench.ask()
        bench.hear("55 " + frame(2, RESPONSE))
        bench.pass_time(1.0)
    assert [event.unit for event in bench.told(UnitResting)] == [1]


def test_a_port_that_is_back_ends_all_rests(bench: Bench) -> None:
    fail(bench, FAILURES)
    assert bench.devices[1].is_resting(bench.now)
    bench.unplug()
    bench.plug()
    assert not bench.devices[1].is_resting(bench.now)


def test_idle_bytes_of_long_ago_are_no_beginning_of_a_frame(bench: Bench) -> None:
    fail(bench, FAILURES)
    answer = frame(1, RESPONSE)
    bench.hear(answer[:9])
    bench.pass_time(1.1)
    bench.hear(answer[9:])
    assert bench.devices[1].is_resting(bench.now)
    for _ in range(200):
        bench.hear("55" * 20)
    assert len(bench.line._receiver._scanner._buffer) <= 256
    bench.hear(answer[:9])
    bench.pass_time(0.9)
    bench.hear(answer[9:])
    assert not bench.devices[1].is_resting(bench.now)


@pytest.mark.parametrize("comes", ["noise", "echo"])
def test_two_dead_units_rest_though_something_comes_each_time(comes: str) -> None:
    """They take a small part of the line's time."""
    bench = Bench(virtual=False)
    began, dead = bench.now, 0.0
    while bench.now < began + 60.0:
        for unit in range(1, 11):
            count, sent, asked_at = len(bench.client.answers), len(bench.written), bench.now
            bench.ask(unit=unit)
            while len(bench.client.answers) == count:
                bench.pass_time(0.005)
                if len(bench.written) > sent and bench.line.ledger.current is not None:
                    sent = len(bench.written)
                    bench.hear(bench.written[-1] if comes == "echo" else "00")
                    bench.pass_time(0.005)
                    if unit > 2:
                        bench.respond(unit=unit)
                        bench.pass_time(0.01)
            dead += (bench.now - asked_at) * (unit <= 2)
    assert dead < 0.2 * (bench.now - began)


def test_silence_while_another_unit_is_in_its_window_is_a_failure() -> None:
    bench = Bench(late_window=1000.0)
    fail(bench, 1, unit=2)
    for pdu in ("01 00 00 00 01", "02 00 00 00 01", "04 00 00 00 01"):
        bench.ask(pdu)
        bench.pass_time(1.0)
    assert [event.unit for event in bench.told(UnitResting)] == [1]


def test_a_late_answer_that_collides_is_no_failure_even_if_its_window_has_ended_since() -> None:
    bench = Bench(late_window=LIMIT / 2)
    bench.ask(unit=2)
    bench.pass_time(REQUEST_TIME + LIMIT + 0.003)
    bench.ask()
    bench.hear("02 03 55")
    bench.pass_time(1.0)
    assert bench.client.answers == ["83 0B", "83 0B"]
    assert [bench.devices[unit].breaker.failures for unit in (1, 2)] == [0, 1]


def test_a_broken_frame_while_only_the_unit_itself_is_in_a_window_is_a_failure() -> None:
    bench = Bench(late_window=1000.0)
    for pdu in ("01 00 00 00 01", "02 00 00 00 01", "04 00 00 00 01"):
        bench.ask(pdu)
        bench.hear("55 AA")
        bench.pass_time(1.0)
    assert [event.unit for event in bench.told(UnitResting)] == [1]


class Plant(Bench):
    """Ten units, polled in turn by one client each; the dead ones are silent, the others answer after 200 ms."""

    def __init__(self, *dead: int, timeout: float) -> None:
        super().__init__(max_wait=60.0)
        self.dead = dead
        self.healthy = 0
        self.dead_time = 0.0
        for unit in range(1, 11):
            self.device(unit, timeout=timeout)
        self.clients = {unit: Poller(self, unit) for unit in range(1, 11)}

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        for client in self.clients.values():
            client.poll()
        while self.now < end:
            self._step()
            for client in self.clients.values():
                if client.answered_at <= self.now - 0.05:  # none of them polls the unit that refuses it more often
                    client.poll()

    def _step(self) -> None:
        current, began = self.line.ledger.current, self.now
        if current is not None and current.unit not in self.dead:
            self.pass_time(0.2)
            self.respond(unit=current.unit)
            self.healthy += 1
            return
        deadline = self.line.deadline()
        self.pass_time(0.01 if deadline is None else max(0.0, deadline - self.now))
        if current is not None:
            self.dead_time += self.now - began


class Poller(Asker):
    """Asks its unit again when it has been answered."""

    def __init__(self, plant: Plant, unit: int) -> None:
        super().__init__(f"10.0.0.{unit}:1")
        self.plant = plant
        self.unit = unit
        self.answered_at = 0.0

    def poll(self) -> None:
        self.answered_at = float("inf")
        self.plant.ask(READ, self.unit, self)

    def answer(self, request, pdu) -> None:
        self.answered_at = self.plant.now


@pytest.mark.search
@pytest.mark.parametrize("timeout", [0.3, 1.0])
def test_a_dead_unit_takes_at_most_a_tenth_of_its_lines_time(timeout: float) -> None:
    hour = 3600.0
    plant = Plant(7, timeout=timeout)
    plant.run(hour)
    whole = Plant(timeout=timeout)
    whole.run(600.0)
    assert plant.dead_time <= 0.1 * hour
    assert plant.healthy / hour >= 0.9 * whole.healthy / 600.0
    plant.pass_time(60)
    assert is_empty(plant.line)


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_a_dead_unit_takes_a_tenth_with_repeats_too(retries: int) -> None:
    bench = Bench(retries=retries, retry_within=10.0)
    for _ in range(FAILURES):
        bench.ask()
        bench.pass_time(70.0)
    bench.pass_time(1000.0)
    bench.written.clear()
    begin, stop = bench.now, bench.now + 3600.0
    while bench.now < stop:
        bench.ask()
        bench.pass_time(0.1)
    busy = (REQUEST_TIME + LIMIT) * len(bench.written)
    assert busy / (bench.now - begin) <= 0.1
