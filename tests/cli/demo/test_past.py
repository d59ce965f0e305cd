"""The day that the demo makes up: it fits the demo's own lines and units, and ends before now."""

from datetime import datetime

from gateway.cli.demo import past
from gateway.cli.demo.past import activity
from gateway.timing.history import STEP, UNIT_SLOTS, History, slot_at


def test_it_is_the_day_before_and_nothing_of_it_is_now(day, now):
    numbers = [slot.number for slot in day]
    assert numbers == sorted(set(numbers))
    assert (numbers[0], numbers[-1]) == (slot_at(now) - UNIT_SLOTS + 1, slot_at(now) - 1)


def test_there_is_a_gap_where_the_gateway_did_not_run(day):
    assert 0 < UNIT_SLOTS - 1 - len(day) < 6


def test_it_has_the_lines_and_units_of_the_demo_and_no_others(day, plan):
    lines = {line.line.name for line in plan.lines}
    units = {device.name for line in plan.lines for device in line.devices}
    assert all((slot.lines.keys(), slot.units.keys()) == (lines, units) for slot in day)


def test_who_is_in_trouble_is_in_the_demo(plan):
    """Else somebody has renamed a line or a unit, and its trouble is shown no more."""
    lines = {line.line.name for line in plan.lines}
    units = {device.name for line in plan.lines for device in line.devices}
    assert {trouble.unit for trouble in past.TROUBLES} | set(past._OFF) <= units
    assert {*past._BUSY, past.UNPLUGGED.unit} == lines | {past.UNPLUGGED.unit}


def test_what_it_says_fits_together(day):
    for slot in day:
        for use in slot.units.values():
            ended = use.timeouts + use.failed + use.unsent + use.responses
            assert ended == use.requests
            assert use.exceptions <= use.responses
            assert 0 <= use.resting <= STEP
        for line in slot.lines.values():
            assert line.seconds == STEP
            assert line.busy + line.down <= STEP
            assert line.failed <= line.sent


def test_somebody_was_in_trouble_and_most_was_well(day):
    lost = [slot.number for slot in day if slot.units["drive-72"].lost]
    assert 0 < len(lost) < len(day) / 10
    assert sum(slot.lines["yard"].down > 0 for slot in day) == 3600 / STEP
    assert not any(slot.units["silo-1"].unanswered for slot in day)


def test_a_history_takes_it_and_shows_it_beside_what_happens(day, now):
    history = History()
    history.load(day)
    history.add(now, day[0].lines, day[0].units)
    shown = history.last(now, UNIT_SLOTS).slots
    assert sum(slot is not None for slot in shown) == len(day) + 1


def test_a_plant_rests_at_night():
    local = datetime(2026, 11, 28).astimezone().timestamp()
    assert activity(local + 3 * 3600) < 0.05
    assert activity(local + 10 * 3600) > 0.9
    assert all(0 <= activity(local + 600 * number) <= 1 for number in range(144))
