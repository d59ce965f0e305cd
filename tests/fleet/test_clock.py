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
    assert deadline_for("ab", clocks.until(0.5, 10.0)) == pytest.approx(5000.0 + 0.5 * (1 - DRIFT))


#: What a time service changes the rate of a clock by.
RATES = st.floats(1 - 0.0833, 1 + 0.0833)


@given(
    delay=st.floats(0, 2),
    since=st.floats(0, SILENCE / 2),
    patience=st.floats(0, 300),
    ahead=st.floats(-1e6, 1e6),
    owners_rate=RATES,
    our_rate=RATES,
)
def test_it_is_over_before_our_patience_is(delay, since, patience, ahead, owners_rate, our_rate):
    """`delay` is how long the heartbeat was under way; `since` then and `patience` are by our clock."""
    clocks = heard("ab", ahead, 100.0)
    deadline = deadline_for("ab", clocks.until(patience, 100.0 + since))
    assert deadline is not None
    owner_shows = ahead + owners_rate * (delay + (since + patience) / our_rate)
    assert deadline <= owner_shows + 2e-6


def test_the_last_heartbeat_counts():
    """Also when it says less than the last but one: its machine may have stood still."""
    clocks = heard("ab", 5000.0, 10.0)
    clocks.hear(heartbeat("ab", 4000.0), 11.0)
    assert deadline_for("ab", clocks.until(1.0, 11.0)) == pytest.approx(4000.0 + 1 - DRIFT, abs=1e-5)


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
    assert deadline_for("ab", header) == pytest.approx(5000.0 + 2 * (1 - DRIFT), abs=0.001)
    assert deadline_for("cd", header) == pytest.approx(70.0 + 1.5 * (1 - DRIFT), abs=0.001)
    assert deadline_for("c", header) is None


def test_the_oldest_of_too_many_is_forgotten():
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
