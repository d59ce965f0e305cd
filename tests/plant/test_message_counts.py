"""How many messages the broker has confirmed, and how many in a second."""

from gateway.plant.broker import STEP, MessageCounts


def test_the_rate_is_that_of_the_last_whole_step():
    counts = MessageCounts()
    for tenth in range(300):
        counts.confirm(1000.0 + tenth / 10)
    assert counts.confirmed == 300
    assert counts.per_second(1030.0) == 10.0
    assert counts.per_second(1030.0 + STEP / 2) == 10.0


def test_the_rate_ends_with_the_messages():
    counts = MessageCounts()
    counts.confirm(1000.0)
    assert counts.per_second(1000.0) == 0.0
    assert counts.per_second(1000.0 + STEP) == 1 / STEP
    assert counts.per_second(1000.0 + 2 * STEP) == 0.0
    counts.confirm(1000.0 + 9 * STEP)
    assert counts.per_second(1000.0 + 9 * STEP) == 0.0
