"""Another site's clock, as its heartbeats tell it: never later than it is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.fleet.clock import DRIFT, MOST_GATEWAYS, SILENCE, Clocks, deadline_for, heartbeat


def heard(instance: str, clock: float, now: float) -> Clocks:
    clocks = Clocks()
    assert clocks.hear(heartbeat(instance, clock), now)
    return clocks


def test_a_deadline_is_told_by_the_clock_of_the_owner():
    clocks = heard("ab", 5000.0, 10.0)
    assert deadline_for("ab", clocks.until(0.5, 10.0)) == 5000.5


@given(
    delay=st.floats(0, 2),
    since=st.floats(0, SILENCE / 2),
    patience=st.floats(0, 10),
    ahead=st.floats(-1e6, 1e6),
    drift=st.floats(-DRIFT / 2, DRIFT / 2),
)
def test_it_is_never_later_than_it_should_be(delay, since, patience, ahead, drift):
    """`delay` is how long the heartbeat was under way, `drift` how much faster the other clock runs."""
    heard_at = 100.0

    def owners(now: float) -> float:
        return ahead + (now - (heard_at - delay)) * (1 + drift)

    clocks = heard("ab", owners(heard_at - delay), heard_at)
    now = heard_at + since
    deadline = deadline_for("ab", clocks.until(patience, now))
    assert deadline is not None
    assert deadline <= owners(now) + patience + 2e-6


def test_the_last_heartbeat_counts():
    """Also when it says less than the last but one: its machine may have stood still."""
    clocks = heard("ab", 5000.0, 10.0)
    clocks.hear(heartbeat("ab", 4000.0), 11.0)
    assert deadline_for("ab", clocks.until(1.0, 11.0)) == 4001.0


def test_who_is_silent_is_not_asked():
    clocks = heard("ab", 5000.0, 10.0)
    assert clocks.is_heard(10.0 + SILENCE - 0.01)
    assert not clocks.is_heard(10.0 + SILENCE)
    assert clocks.until(1.0, 10.0 + SILENCE) == ""
    assert clocks.deadline() == 10.0 + SILENCE


def test_nobody_was_ever_heard():
    assert not Clocks().is_heard(0.0)
    assert Clocks().deadline() is None


def test_each_gateway_of_a_site_finds_its_own_deadline():
    clocks = heard("ab", 5000.0, 10.0)
    clocks.hear(heartbeat("cd", 70.0), 10.5)
    header = clocks.until(1.0, 11.0)
    assert deadline_for("ab", header) == pytest.approx(5002.0, abs=0.001)
    assert deadline_for("cd", header) == pytest.approx(71.5, abs=0.001)
    assert deadline_for("c", header) is None


def test_the_eldest_of_too_many_is_forgotten():
    clocks = Clocks()
    for number in range(MOST_GATEWAYS + 1):
        clocks.hear(heartbeat(f"a{number}", 100.0), 10.0)
    header = clocks.until(1.0, 10.0)
    assert deadline_for("a0", header) is None
    assert len(header.split()) == MOST_GATEWAYS


@pytest.mark.parametrize("body", [b"", b"ab", b"ab soon", b"ab nan", b"ab inf", b"a=b 5", b"\xff 5", b"ab 5 6", b" 5"])
def test_what_is_no_heartbeat_is_none(body):
    clocks = Clocks()
    assert not clocks.hear(body, 10.0)
    assert clocks.until(1.0, 10.0) == ""
