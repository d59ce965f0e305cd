"""Whether a limit suits response times."""

import pytest

from gateway.timing.proposal import MeasuredTimes, Proposal
from gateway.timing.verdict import verdict


@pytest.mark.parametrize(
    ("share", "responses", "late", "limit_ms", "proposed_ms", "expected"),
    [
        (None, 0, 0, 1000, None, "few"),
        (0.9, 19, 0, 1000, None, "few"),
        (0.8, 20, 0, 1000, None, "tight"),
        (0.79, 20, 0, 1000, None, "right"),
        (0.1, 5, 1, 1000, None, "tight"),
        (0.05, 100, 0, 500, None, "long"),
        (0.05, 99, 0, 500, None, "few"),
        (0.05, 100, 0, 499, None, "right"),
        (0.06, 100, 0, 1000, None, "right"),
        (0.06, 100, 0, 1000, 200, "long"),
        (0.06, 100, 0, 1000, 201, "right"),
        (0.02, 100, 0, 1000, 1100, "right"),
    ],
)
def test_a_limit_is_judged_by_what_responses_need_of_it(share, responses, late, limit_ms, proposed_ms, expected):
    assert verdict(share, responses, late, limit_ms, proposed_ms) == expected


def test_a_proposed_limit_is_the_wire_and_the_table_with_its_margin():
    row = MeasuredTimes(3, 10, (0.02,) * 20, limit_ms=1010.0, allowed_ms=1000.0)
    assert Proposal([row], 1.5).limit(row) == pytest.approx(0.01 + 1.5 * 0.02)


def test_the_margin_grows_where_some_responses_take_much_longer():
    row = MeasuredTimes(3, 10, (0.02,) * 20 + (0.04,) * 5, limit_ms=1000.0, allowed_ms=1000.0)
    assert Proposal([row], 1.5).margin == pytest.approx(2.5)


def test_a_proposed_limit_stays_when_the_slowest_response_is_not_among_the_last_ones():
    row = MeasuredTimes(3, 10, (0.02,) * 20, limit_ms=1000.0, allowed_ms=1000.0, longest=0.2)
    assert Proposal([row], 1.5).limit(row) == pytest.approx(0.25, abs=0.002)
    assert verdict(0.05, 1000, 0, 1000.0, 250.0) == "right"
