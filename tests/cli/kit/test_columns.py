"""Tables of many rows that only count."""

from gateway.cli.kit.columns import without_middles


def sensors(first: int, last: int, wait: str = "3.4 s") -> list[tuple[str, str, str]]:
    return [(str(each), f"sensor-2-{each}", wait) for each in range(first, last + 1)]


def test_of_many_rows_that_count_the_first_and_the_last_are_shown():
    rows = [("-", "press", "3.4 s"), *sensors(1, 100), *sensors(101, 110, "5 s")]
    assert without_middles(rows, (0, 1)) == [
        ("-", "press", "3.4 s"),
        ("1", "sensor-2-1", "3.4 s"),
        ("...", "", ""),
        ("100", "sensor-2-100", "3.4 s"),
        ("101", "sensor-2-101", "5 s"),
        ("...", "", ""),
        ("110", "sensor-2-110", "5 s"),
    ]


def test_a_few_rows_are_all_shown():
    assert without_middles(sensors(1, 9), (0, 1)) == sensors(1, 9)


def test_a_gap_or_another_value_is_seen():
    gap = [*sensors(1, 5), *sensors(7, 12)]
    assert without_middles(gap, (0, 1)) == gap
    waits = [row for each in range(12) for row in sensors(each, each, f"{each} s")]
    assert without_middles(waits, (0, 1)) == waits
    others = [(str(each), f"sensor-{each}-2", "") for each in range(5)] + [
        (str(each), f"press-{each}", "") for each in range(5, 9)
    ]
    assert without_middles(others, (0, 1)) == others
