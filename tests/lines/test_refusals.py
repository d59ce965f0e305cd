"""Refused requests: the first of a client is told at once, further ones together, and none is forgotten."""

from gateway.events import Event, QueueFull
from gateway.lines.refusals import MOST, TOGETHER
from gateway.observe.backlog import entry_of
from gateway.observe.limits import Limits
from kit.asker import Asker
from kit.line_bench import Bench
from kit.upstream_bench import UpstreamBench

ONE, OTHER = "10.0.0.1:1", "10.0.0.2:1"


def told(events: list[Event]) -> list[tuple[str, int, int | None]]:
    return [(each.client, each.unit, each.times) for each in events if isinstance(each, QueueFull)]


def full_line() -> tuple[Bench, Asker, Asker]:
    """A line for which a request of each of two clients waits, and no more may."""
    bench, one, other = Bench(queue=2, coalesce=False), Asker(ONE), Asker(OTHER)
    for client in (one, one, other):
        bench.ask(client=client)
    return bench, one, other


def test_further_refusals_of_a_client_for_a_device_are_told_together_later():
    bench, one, other = full_line()
    for client, unit, times in ((one, 1, 5), (one, 2, 2), (other, 1, 1)):
        for _ in range(times):
            bench.ask(unit=unit, client=client)
    at_once = [(ONE, 1, None), (ONE, 2, None), (OTHER, 1, None)]
    assert told(bench.events) == at_once
    bench.pass_time(TOGETHER - 0.1)
    assert told(bench.events) == at_once
    bench.pass_time(0.1)
    assert told(bench.events) == [*at_once, (ONE, 1, 4), (ONE, 2, 1)]


def test_an_idle_line_tells_what_it_has_counted_and_is_not_woken_any_more():
    bench, one, _ = full_line()
    refused_at = bench.now
    for _ in range(2):
        bench.ask(client=one)
    for _ in range(3):
        bench.respond()
        bench.pass_time(0.1)
    assert bench.line.deadline() == refused_at + TOGETHER
    bench.pass_time(TOGETHER)
    assert [times for *_, times in told(bench.events)] == [None, 1]
    bench.pass_time(TOGETHER)
    assert bench.line.deadline() is None
    assert len(told(bench.events)) == 2


def test_who_goes_on_asking_has_one_event_each_time_and_after_a_pause_one_at_once():
    bench, one, _ = full_line()
    for pause in (0.0, TOGETHER, TOGETHER, 2 * TOGETHER):
        bench.now += pause
        for _ in range(3):
            bench.ask(client=one)
    assert [times for *_, times in told(bench.events)] == [None, 2, 3, 3, None]


def test_the_log_of_who_goes_on_asking_goes_over_to_one_line_a_minute():
    (bench, one, _), limits, lines = full_line(), Limits(), []
    steady = bench.now + 61
    for _ in range(200):
        bench.events.clear()
        bench.ask(client=one)
        for event in bench.events:
            entry = entry_of(event)
            entry.at = bench.now
            lines += [bench.now] if limits.admit(entry) else []
        lines += [bench.now for _ in limits.counts(bench.now)]
        bench.now += 1.501  # no clock of a machine wakes a line on the dot
    assert 0 < len([each for each in lines if each > steady]) <= (bench.now - steady) / 60


def test_a_line_that_ends_tells_before():
    bench, one, _ = full_line()
    for _ in range(3):
        bench.ask(client=one)
    bench.line.finish(bench.now)
    assert [times for *_, times in told(bench.events)] == [None, 2]


def test_of_too_many_clients_the_first_is_told_earlier():
    bench, one, _ = full_line()
    for _ in range(3):
        bench.ask(client=one)
    for number in range(MOST):
        bench.ask(client=Asker(f"10.1.0.{number}:1"))
    assert [times for client, _, times in told(bench.events) if client == ONE] == [None, 2]
    assert len(told(bench.events)) == MOST + 2


def test_another_server_is_like_a_line():
    bench, one = UpstreamBench(in_flight=1, queue=1), Asker(ONE)
    for _ in range(5):
        bench.ask(client=one)
    assert [times for *_, times in told(bench.events)] == [None]
    bench.pass_time(TOGETHER)
    assert [times for *_, times in told(bench.events)] == [None, 2]
    for _ in range(5):
        bench.ask(client=one)
    bench.upstream.finish(bench.now)
    assert [times for *_, times in told(bench.events)] == [None, 2, 3]
