"""Who takes a line's time."""

from gateway.timing.usage import MOST_ROWS, OTHERS, Usage


def test_time_goes_by_client_unit_and_function():
    usage = Usage()
    for client, unit, function in [("a", 1, 3), ("a", 1, 3), ("a", 1, 4), ("a", 2, 3), ("b", 1, 3)]:
        usage.add(client, unit, function, 0.5)
    rows = {user: (use.seconds, use.transactions) for user, use in usage.look().items()}
    assert rows == {("a", 1, 3): (1.0, 2), ("a", 1, 4): (0.5, 1), ("a", 2, 3): (0.5, 1), ("b", 1, 3): (0.5, 1)}


def test_it_begins_anew_when_it_is_taken():
    usage = Usage()
    usage.add("a", 1, 3, 0.5)
    assert len(usage.take()) == 1
    assert usage.take() == {}


def test_who_has_no_row_is_one_of_the_others():
    usage = Usage()
    for number in range(3 * MOST_ROWS):
        usage.add(f"client-{number}", 1, 3, 0.5)
    usage.add("client-0", 1, 3, 0.5)
    rows = usage.look()
    assert len(rows) == MOST_ROWS + 1
    assert rows["client-0", 1, 3].transactions == 2
    assert rows[OTHERS, 0, 0].transactions == 2 * MOST_ROWS
