"""What waits for the log: in order, bounded, and honest about what is missing."""

from gateway.observe.backlog import MOST_WAITING, MOST_WITH_RESERVE, Backlog, Entry


def entry(number: int) -> Entry:
    return Entry(20, "event", {"number": number})


def took(backlog: Backlog, most: int) -> list[Entry]:
    """The next entries, as the writer takes them."""
    entries: list[Entry] = []
    while len(entries) < most and not backlog.empty():
        found = backlog.get()
        assert found is not None
        entries.append(found)
        backlog.add_note()
    return entries


def taken(backlog: Backlog, most: int) -> list[object]:
    """Numbers of the next entries, and counts of dropped ones as text."""
    return [one.fields.get("number", f"{one.name} {one.fields.get('dropped')}") for one in took(backlog, most)]


def test_entries_leave_in_the_order_in_which_they_came() -> None:
    backlog = Backlog()
    for number in range(5):
        backlog.add(entry(number))
    assert taken(backlog, 10) == [0, 1, 2, 3, 4]


def test_what_a_full_backlog_drops_is_counted_in_its_place() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 7):
        backlog.add(entry(number))
    half = MOST_WAITING // 2
    assert taken(backlog, half) == list(range(half))
    backlog.add(entry(5000))
    assert taken(backlog, MOST_WAITING) == [*range(half, MOST_WAITING), "events_dropped 7", 5000]


def test_until_half_of_it_is_taken_everything_is_dropped() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 1):
        backlog.add(entry(number))
    taken(backlog, 100)
    backlog.add(entry(5000))
    assert taken(backlog, 2 * MOST_WAITING)[-2:] == [MOST_WAITING - 1, "events_dropped 2"]


def test_at_the_end_the_count_stands_behind_all_that_waits() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 7):
        backlog.add(entry(number))
    backlog.add_note(MOST_WITH_RESERVE)
    assert taken(backlog, 2 * MOST_WAITING) == [*range(MOST_WAITING), "events_dropped 7"]


def audit(number: int) -> Entry:
    return Entry(20, "write_audit", {"number": number}, False, write_audits=1)


def test_many_other_entries_leave_room_for_accounts_of_writes() -> None:
    backlog = Backlog()
    for number in range(MOST_WAITING + 7):
        backlog.add(entry(number))
    backlog.add(audit(5000))
    assert taken(backlog, 2 * MOST_WAITING)[MOST_WAITING:] == [5000, "events_dropped 7"]


def test_accounts_of_writes_are_bounded_too_and_those_that_are_dropped_are_counted_by_themselves() -> None:
    backlog = Backlog()
    for number in range(MOST_WITH_RESERVE + 5):
        backlog.add(audit(number))
    backlog.add(entry(1))
    last = took(backlog, 2 * MOST_WITH_RESERVE)[-1]
    assert (last.name, last.fields) == ("events_dropped", {"dropped": 6, "write_audits": 5})
