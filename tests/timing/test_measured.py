"""What a line's time went into, at 10 ms a character: an RTU frame is its PDU and three characters more."""

from math import inf

import pytest

from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.timing.measured import NEVER, Phases, Times, TimeSpent

LINE = LineTiming("rtu", 1000, CharacterFormat.parse("8N1"))


def spent(*transactions: tuple[float, float, float, int, float]) -> Phases:
    spending = TimeSpent()
    spending.tune(LINE)
    for each in transactions:
        spending.add(*each)
    return spending.phases()


def phases(request: float, wait: float, response: float, gap: float) -> Phases:
    return pytest.approx((request, wait, response, gap), abs=1e-9)


def test_a_transaction_with_a_response() -> None:
    """Request 20.0 to 20.08, response of 5 + 3 characters up to 20.50, silence until 20.535."""
    assert in_order(spent((20.0, 20.08, 20.50, 5, 20.535))) == phases(0.08, 0.34, 0.08, 0.035)


def test_a_transaction_without_a_response() -> None:
    assert in_order(spent((20.0, 20.08, 21.08, 0, 21.0))) == phases(0.08, 1.0, 0.0, 0.0)


def test_a_response_that_came_at_once_took_no_longer_than_there_was() -> None:
    assert in_order(spent((20.0, 20.08, 20.10, 5, 20.10))) == phases(0.08, 0.0, 0.02, 0.0)


def test_a_port_without_a_wire_is_done_before_the_request_could_be_on_one() -> None:
    assert in_order(spent((20.0, 20.08, 20.03, 5, 20.04))) == phases(0.03, 0.0, 0.0, 0.01)


def test_all_that_was_and_what_is_under_way() -> None:
    spending = TimeSpent()
    spending.tune(LINE)
    assert spending.phases() == Phases(0.0, 0.0, 0.0, 0.0)
    spending.add(20.0, 20.08, 20.50, 5, 20.535)
    spending.add(30.0, 30.08, 30.50, 5, 30.535)
    whole = spending.phases(2.0, 5.0)
    assert in_order(whole) == phases(2.16, 5.68, 0.16, 0.07)
    assert whole.busy == pytest.approx(8.07)


def in_order(phases_: Phases) -> tuple[float, float, float, float]:
    return phases_.request, phases_.wait, phases_.response, phases_.gap


def test_answers_are_counted_with_their_share_of_the_limit() -> None:
    times = Times()
    assert (times.answered_at, times.limit) == (-inf, 0.0) == (NEVER, 0.0)
    times.answered(20.5, 20.1, 0.5)
    times.answered(30.5, 30.1, 2.0)
    assert (times.answered_at, times.limit) == (30.5, 2.0)
    assert times.answer.total == pytest.approx(0.8)
    assert times.share.total == pytest.approx(0.8 + 0.2)


def test_without_a_limit_an_answer_has_no_share_of_it() -> None:
    times = Times()
    times.answered(20.5, 20.1, 0.0)
    assert times.share.total == 0.0
    assert times.share.counts[0] == 1
    assert times.answer.total == pytest.approx(0.4)


def test_the_limit_of_the_slowest_late_answer_is_kept() -> None:
    times = Times()
    assert not times.came_late(0.1, 0.1)
    for elapsed, limit in ((0.05, 0.04), (0.3, 0.2), (0.06, 0.01)):
        assert times.came_late(elapsed, limit)
    assert (times.late, times.latest, times.latest_limit) == (3, 0.3, 0.2)
