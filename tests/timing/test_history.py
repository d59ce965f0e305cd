"""Slots of time: what belongs to which, what is kept for how long, and what a clock that is set does to them."""

import pytest

from gateway.timing.history import LINE_SLOTS, MOST_SLOTS, STEP, UNIT_SLOTS, History, LineUse, Slot, UnitUse, slot_at

NOON = 1_777_636_800.0
LINE = LineUse(seconds=10.0, busy=4.0, sent=20, failed=1)
UNIT = UnitUse(requests=20, timeouts=1, responses=19, answer=1.9, share=9.5)


def add(history: History, time: float, line: LineUse = LINE, unit: UnitUse = UNIT) -> None:
    history.add(time, {"hall": line}, {"silo": unit})


def sent(history: History, time: float, count: int) -> list[int | None]:
    """What was sent in each of the last slots."""
    return [None if slot is None else slot.lines["hall"].sent for slot in history.last(time, count).slots]


@pytest.fixture
def history() -> History:
    return History()


def test_what_happens_within_a_slot_is_added_up(history):
    for second in (10, 20, STEP - 1):
        add(history, NOON + second)
    add(history, NOON + STEP)
    past = history.last(NOON + STEP, 2)
    assert past.first == slot_at(NOON)
    assert past.slots[0].lines["hall"] == LineUse(30.0, 12.0, 0.0, 60, 3)
    assert past.slots[0].lines["hall"].busy_share == 0.4
    assert past.slots[0].units["silo"].requests == 60
    assert past.slots[0].units["silo"].share == 28.5
    assert past.slots[1].units["silo"] == UNIT


def test_time_without_the_gateway_is_a_gap_and_no_zero(history):
    add(history, NOON)
    history.add(NOON + 3 * STEP, {"hall": LineUse(10.0)}, {})
    assert sent(history, NOON + 3 * STEP, 5) == [None, 20, None, None, 0]


def test_a_unit_that_did_nothing_takes_no_place(history):
    history.add(NOON, {"hall": LineUse(10.0)}, {})
    assert history.last(NOON, 1).slots[0].units == {}


def test_units_are_kept_for_a_day_and_lines_for_a_week(history):
    for number in range(LINE_SLOTS + 10):
        add(history, NOON + number * STEP)
    end = NOON + (LINE_SLOTS + 9) * STEP
    slots = history.last(end, LINE_SLOTS + 10).slots
    assert [slot is None for slot in slots] == [True] * 10 + [False] * LINE_SLOTS
    assert [bool(slot.units) for slot in slots[10:]] == [False] * (LINE_SLOTS - UNIT_SLOTS) + [True] * UNIT_SLOTS


def test_a_clock_that_is_set_back_shows_nothing_of_its_future(history):
    for number in range(12):
        add(history, NOON + number * STEP)
    back = NOON + 6 * STEP
    add(history, back)
    assert sent(history, back, 8) == [None, 20, 20, 20, 20, 20, 20, 40]
    assert sent(history, NOON + 11 * STEP, 5) == [20] * 5


def test_a_clock_that_begins_in_1970_loses_no_history(history):
    """Many small computers have no clock that runs without power."""
    for number in range(LINE_SLOTS):
        add(history, NOON + number * STEP)
    later = History()
    later.load([slot for slot in history.last(NOON + (LINE_SLOTS - 1) * STEP, LINE_SLOTS).slots if slot])
    add(later, 30.0)
    add(later, 30.0 + STEP)
    end = NOON + LINE_SLOTS * STEP
    add(later, end)
    assert sent(later, end, LINE_SLOTS) == [20] * LINE_SLOTS
    assert sent(later, 30.0 + STEP, 2) == [None, None]


def test_a_clock_that_is_set_back_again_and_again_does_not_fill_the_memory(history):
    for time in range(3 * LINE_SLOTS, 0, -1):
        add(history, NOON + time * STEP)
    slots = history.last(NOON + 4 * LINE_SLOTS * STEP, 4 * LINE_SLOTS).slots
    assert len([slot for slot in slots if slot is not None]) == MOST_SLOTS
    assert sent(history, NOON + STEP, 1) == [20]


def test_only_what_has_changed_is_written(history):
    add(history, NOON)
    add(history, NOON + STEP)
    assert [slot.number for slot in history.changes().written] == [slot_at(NOON), slot_at(NOON + STEP)]
    assert history.changes() == ([], frozenset())
    add(history, NOON + STEP)
    (slot,) = history.changes().written
    assert (slot.number, slot.lines["hall"].sent) == (slot_at(NOON + STEP), 40)


def test_what_is_written_does_not_change_meanwhile(history):
    add(history, NOON)
    (slot,) = history.changes().written
    add(history, NOON)
    assert slot.units["silo"] == UNIT


def test_what_could_not_be_written_is_written_later(history):
    add(history, NOON)
    changes = history.changes()
    add(history, NOON + STEP)
    history.put_back(changes)
    assert [slot.number for slot in history.changes().written] == [slot_at(NOON), slot_at(NOON + STEP)]


def test_the_file_forgets_what_the_history_does(history):
    add(history, NOON)
    history.changes()
    add(history, NOON + UNIT_SLOTS * STEP)
    changes = history.changes()
    assert [(slot.number, bool(slot.units)) for slot in changes.written] == [
        (slot_at(NOON), False),
        (slot_at(NOON) + UNIT_SLOTS, True),
    ]
    add(history, NOON + LINE_SLOTS * STEP)
    changes = history.changes()
    assert changes.gone == {slot_at(NOON)}
    history.put_back(changes)
    assert history.changes().gone == {slot_at(NOON)}


def test_a_restart_goes_on_with_the_slot_in_which_it_was(history):
    add(history, NOON)
    add(history, NOON + STEP)
    slots = [Slot.read(slot.number, slot.as_text()) for slot in history.changes().written]
    after = History()
    add(after, NOON + STEP)
    after.load(slots)
    assert sent(after, NOON + STEP, 2) == [20, 40]
    assert [slot.lines["hall"].sent for slot in after.changes().written] == [40]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"lines": {}}',
        '{"lines": {"a": 1}, "units": {}}',
        '{"lines": {"a": ["x"]}, "units": {}}',
        '{"lines": {}, "units": {"a": "b"}}',
        '{"lines": {}, "units": {"a": [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]}}',
    ],
)
def test_a_text_that_is_no_slot_is_refused(text):
    with pytest.raises(ValueError, match=r".+"):
        Slot.read(1, text)
