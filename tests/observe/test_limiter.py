"""Ten lines a second about the same, and the count of the rest."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.observe.limiter import MOST_SUBJECTS, Limiter, Subject, subject_of

MOST_LINES = Limiter().lines
SILO = Subject(30, "request_timeout", (("line", "hall-a"), ("unit", 1)))
PRESS = Subject(30, "request_timeout", (("line", "hall-a"), ("unit", 6)))


def test_what_identifies_an_event_is_its_place_not_its_numbers() -> None:
    fields = {"line": "hall-a", "unit": 1, "device": "silo-1", "function": 3, "elapsed_ms": 1009.3}
    assert subject_of(30, "request_timeout", fields) == SILO


@pytest.mark.parametrize(
    ("client", "host"),
    [("10.0.0.9:49152", "10.0.0.9"), ("[fe80::1]:49152", "[fe80::1]"), ("control", "control")],
)
def test_a_client_is_its_host_because_each_connection_has_another_port(client: str, host: str) -> None:
    fields = {"listener": "scada", "client": client, "reason": "full"}
    assert subject_of(30, "client_rejected", fields).key == (("listener", "scada"), ("client", host))


def test_users_of_the_page_are_told_apart_so_that_none_hides_what_another_one_does() -> None:
    anna, mes = ({"listener": "web", "client": f"web:{name}@10.2.0.7"} for name in ("anna", "mes"))
    assert subject_of(30, "write_audit", anna) != subject_of(30, "write_audit", mes)


def test_what_a_client_does_is_about_the_client_whatever_unit_it_names() -> None:
    fields = {"listener": "scada", "client": "10.0.0.9:49152", "unit": 7, "function": 6}
    assert subject_of(30, "access_denied", fields) == subject_of(30, "access_denied", {**fields, "unit": 8})


def test_each_warning_about_a_config_is_a_subject_of_its_own() -> None:
    assert subject_of(30, "config_warning", {"problem": "a"}) != subject_of(30, "config_warning", {"problem": "b"})


def test_ten_lines_pass_and_the_rest_is_counted_once_the_second_is_over() -> None:
    limiter = Limiter()
    assert [limiter.admits(SILO, 0.01 * n) for n in range(100)] == [True] * MOST_LINES + [False] * 90
    assert limiter.next_due == pytest.approx(1.1)
    assert list(limiter.due(1.09)) == []
    assert list(limiter.due(1.1)) == [(SILO, 90)]
    assert limiter.next_due is None
    assert list(limiter.due(inf)) == []


def test_of_one_line_in_ten_seconds_the_count_takes_no_place() -> None:
    lines, counts = written_of(Limiter(lines=1, seconds=10.0), [0.1 * n for n in range(300)])
    assert lines == pytest.approx([0.0, 10.0, 20.0])
    assert [number for _, number in counts] == [99, 99]


def test_what_is_never_steady_is_told_for_ever() -> None:
    lines, _ = written_of(Limiter(lines=1, seconds=10.0, steady=inf), [0.5 * n for n in range(7200)])
    assert lines == [10.0 * n for n in range(360)]


def test_one_subject_takes_nothing_from_another() -> None:
    limiter = Limiter()
    assert not all(limiter.admits(SILO, 0.0) for _ in range(MOST_LINES + 1))
    assert limiter.admits(PRESS, 0.0)


def test_less_than_ten_lines_a_second_are_never_suppressed() -> None:
    limiter = Limiter()
    assert all(limiter.admits(SILO, 0.11 * n) for n in range(100))


def test_at_the_end_every_count_is_due() -> None:
    limiter = Limiter()
    for _ in range(MOST_LINES + 1):
        limiter.admits(SILO, 0.0)
        limiter.admits(PRESS, 0.0)
    assert list(limiter.due(inf)) == [(SILO, 1), (PRESS, 1)]


def written_of(limiter: Limiter, times: list[float]) -> tuple[list[float], list[tuple[float, int]]]:
    """When something that comes at these times is written, and the counts with theirs. None of it may be lost."""
    lines, counts = [], []
    for now in times:
        while limiter.next_due is not None and limiter.next_due <= now:
            due = limiter.next_due
            counts += [(due, number) for _, number in limiter.due(due)]
        if limiter.admits(SILO, now):
            lines.append(now)
    rest = sum(number for _, number in limiter.due(inf))
    assert len(lines) + sum(number for _, number in counts) + rest == len(times)
    return lines, counts


def lines_of(limiter: Limiter, times: list[float]) -> list[float]:
    """When lines are written about something that comes at these times, counts too."""
    lines, counts = written_of(limiter, times)
    return [*lines, *(due for due, _ in counts)]


def test_what_goes_on_for_a_minute_is_told_once_a_minute_from_then_on() -> None:
    lines = lines_of(Limiter(), [0.2 * n for n in range(5 * 3600)])
    assert sum(line < 60.0 for line in lines) == 300
    assert 58 <= sum(line >= 60.0 for line in lines) <= 60


def test_what_comes_again_after_a_pause_is_told_at_once() -> None:
    limiter = Limiter()
    lines_of(limiter, [5.0 * n for n in range(100)])
    assert not limiter.admits(SILO, 500.0)
    assert limiter.admits(SILO, 511.0)


def test_what_comes_now_and_then_is_told_each_time() -> None:
    times = [11.0 * n for n in range(100)]
    assert lines_of(Limiter(), times) == times


@given(st.lists(st.floats(0.0, 0.3) | st.floats(0.0, 15.0), max_size=300))
def test_no_second_has_more_lines_and_no_event_is_lost(pauses: list[float]) -> None:
    limiter = Limiter()
    now, lines, told = 0.0, [], 0
    for pause in pauses:
        now += pause
        for _, count in limiter.due(now):
            lines.append(now)
            told += count
        if limiter.admits(SILO, now):
            lines.append(now)
            told += 1
    told += sum(count for _, count in limiter.due(inf))
    assert told == len(pauses)
    assert all(sum(start <= line < start + 1.0 for line in lines) <= MOST_LINES for start in lines)


def test_too_many_subjects_are_told_apart_by_their_event_only() -> None:
    limiter = Limiter()
    passed = [limiter.admits(Subject(30, "access_denied", (("unit", n),)), 0.0) for n in range(MOST_SUBJECTS + 50)]
    assert sum(passed) == MOST_SUBJECTS + MOST_LINES
    assert list(limiter.due(inf)) == [(Subject(30, "access_denied"), 40)]


def test_subjects_that_rest_make_room_for_others() -> None:
    limiter = Limiter()
    for n in range(MOST_SUBJECTS):
        limiter.admits(Subject(30, "access_denied", (("unit", n),)), 0.0)
    for _ in range(MOST_LINES + 1):
        limiter.admits(SILO, 1.0)
    assert list(limiter.due(inf)) == [(SILO, 1)]
