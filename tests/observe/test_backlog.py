"""What waits for the log: in order, bounded, and honest about what is missing."""

from gateway.observe.backlog import MOST_WAITING, MOST_WITH_RESERVE, Backlog, Entry


def entry(number: int) -> Entry:
    return Entry(float(number), float(number), 20, "event", {"number": number})


def taken(backlog: Backlog, most: int) -> list[object]:
    """Numbers of the next entries, and counts of dropped ones as text."""
    entries = [found for _ in range(most) if (found := backlog.take(0.0)) is not None]
    return [one.fields.get("number", f"{one.name} {one.fields.get('dropped')}") for one in entries]


def test_entries_leave_in_the_order_in_which_they_came() -> None:
    backlog = Backlog()
    for number in range(5):
        backlog.put(entry(number))
    assert taken(backlog, 10) == [0, 1, 2, 3, 4]


def test_what_a_full_backlog_drops_is_counted_in_its_place() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 7):
        backlog.put(entry(number))
    half = MOST_WAITING // 2
    assert taken(backlog, half) == list(range(half))
    backlog.put(entry(5000))
    assert taken(backlog, MOST_WAITING) == [*range(half, MOST_WAITING), "events_dropped 7", 5000]


def test_until_half_of_it_is_taken_everything_is_dropped() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 1):
        backlog.put(entry(number))
    taken(backlog, 100)
    backlog.put(entry(5000))
    assert taken(backlog, 2 * MOST_WAITING)[-2:] == [MOST_WAITING - 1, "events_dropped 2"]


def test_it_is_done_when_it_is_closed_and_all_was_taken() -> None:
    backlog = Backlog()
    backlog.put(entry(1))
    backlog.close()
    assert not backlog.is_done
    assert taken(backlog, 2) == [1]
    assert backlog.is_done
    assert backlog.take() is None


def audit(number: int) -> Entry:
    return Entry(float(number), float(number), 20, "write_audit", {"number": number}, False, write_audits=1)


def test_many_other_entries_leave_room_for_accounts_of_writes() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 7):
        backlog.put(entry(number))
    backlog.put(audit(5000))
    assert taken(backlog, 2 * MOST_WAITING)[MOST_WAITING:] == [5000, "events_dropped 7"]


def test_accounts_of_writes_are_bounded_too_and_those_that_are_dropped_are_counted_by_themselves() -> None:
    backlog = Backlog()
    for number in range(MOST_WITH_RESERVE + 5):
        backlog.put(audit(number))
    backlog.put(entry(1))
    last = [found for _ in range(2 * MOST_WITH_RESERVE) if (found := backlog.take(0.0)) is not None][-1]
    assert (last.name, last.fields) == ("events_dropped", {"dropped": 6, "write_audits": 5})
