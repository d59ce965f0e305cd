"""What mirrors and virtual units cost with many ranges: the same as with few, counted in calls."""

from collections.abc import Callable

import pytest

from gateway.images.polling import MOST_AT_ONCE
from kit.many_ranges import EVERY, Client, ManyRanges, calls_for

FEW, MANY = 100, 1000


def read_of_another(unit: ManyRanges) -> Callable[[], object]:
    """None of these reads is remembered, as after many others."""
    sizes = iter(range(1, 10))
    return lambda: unit.read(0, size=next(sizes))


def write(unit: ManyRanges) -> Callable[[], object]:
    return lambda: unit.write(5)


def write_to_what_waits(unit: ManyRanges) -> Callable[[], object]:
    """All is due and waits for its turn."""
    unit.spend(EVERY)
    unit.tick()
    return lambda: unit.write(5)


def write_and_read(unit: ManyRanges) -> Callable[[], object]:
    """The client gets what is polled after its write."""

    def step() -> None:
        answers = unit.client.answers
        unit.write(5)
        unit.read(5)
        unit.device.polls.tick(unit.now)
        while unit.device.asked:
            unit.device.answer_one()
        assert unit.client.answers == answers + 2

    return step


def poll(unit: ManyRanges) -> Callable[[], object]:
    unit.spend(EVERY)
    unit.tick()
    return unit.device.answer_one


def missed(unit: ManyRanges) -> Callable[[], object]:
    unit.spend(EVERY)
    unit.tick()
    return lambda: unit.device.asked.popleft().end()


def refused(unit: ManyRanges) -> Callable[[], object]:
    unit.spend(EVERY)
    unit.tick()
    return lambda: unit.device.answer_one(b"\x83\x02")


def freshness(unit: ManyRanges) -> Callable[[], object]:
    """Of all devices, after a write to one of them."""

    def step() -> None:
        unit.write(5)
        unit.ask(1, 0, len(unit.devices))
        unit.ask(4, 0, 1)

    return step


SPENDING = [read_of_another, write, write_to_what_waits, write_and_read, poll, missed, refused]


@pytest.mark.parametrize(
    ("spending", "is_mapped"),
    [*((each, False) for each in SPENDING), *((each, True) for each in SPENDING), (freshness, True)],
)
def test_it_costs_the_same_whatever_the_number_of_ranges(spending, is_mapped):
    def cost(ranges: int) -> float:
        step = spending(ManyRanges(ranges, is_mapped=is_mapped))
        for _ in range(3):
            step()
        return min(calls_for(step) for _ in range(5))

    cost(FEW)  # what requests mean is remembered from then on
    assert cost(MANY) <= 1.1 * cost(FEW)


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("is_written", [False, True])
def test_clients_wait_for_few_of_the_polls_that_are_due(is_written, rests):
    """For those of a device that rests too, of which its readers are told."""
    unit = ManyRanges(MANY)
    unit.device.rests = rests
    if is_written:
        unit.write(0)
    else:
        unit.spend(EVERY)
    polls, steps = unit.device.polls, 0
    while (due := polls.deadline()) is not None and due <= unit.now:
        assert calls_for(lambda: polls.tick(unit.now)) < 40 * MOST_AT_ONCE
        steps += 1
    assert MANY / MOST_AT_ONCE <= steps < 2 * MANY / MOST_AT_ONCE


@pytest.mark.interpreted
def test_an_answer_wakes_those_who_wait_for_it_and_no_others():
    unit = ManyRanges(200, is_polled=False)
    first, others = Client("10.0.0.1:1"), [Client(f"10.0.0.2:{port}") for port in range(100)]
    unit.read(0, first)
    for other in others:
        unit.read(1, other)
    unit.tick()
    few = calls_for(unit.device.answer_one)
    assert (first.answers, {other.answers for other in others}) == (1, {0})
    many = calls_for(unit.device.answer_one)
    assert {other.answers for other in others} == {1}
    assert few < many / 20


def test_a_poll_that_waits_for_its_turn_at_a_write_is_sent_once():
    unit = ManyRanges(200)
    unit.spend(EVERY)
    unit.tick()
    in_progress = len(unit.device.asked)
    unit.write(0)
    assert unit.poll_all() == 200 + in_progress
