"""The last events: which are kept, which are counted, and since when something is wrong."""

import json

import pytest

from gateway import events
from gateway.observe import last_events as module
from gateway.observe.last_events import (
    ALIKE_FOR,
    COUNTS_EVERY,
    MOST_ALIKE,
    MOST_BYTES,
    MOST_EVENTS,
    MOST_OF_A_KIND,
    OF_A_KIND_FOR,
    LastEvents,
    read_row,
)

LOST = events.LineLost("hall", "/dev/hall", "unplugged")
REOPENED = events.LineReopened("hall", "/dev/hall", 3.0)


class Clock:
    def __init__(self) -> None:
        self.now = 1_777_636_800.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def last(clock):
    return LastEvents(clock)


def add(last: LastEvents, *some: events.Event, by: float = 1.0) -> None:
    for event in some:
        last.add(event)
        last._clock.now += by


def names(last: LastEvents) -> list[str]:
    return [each.name for each in last.all()]


def timeout(device: str, line: str = "hall") -> events.RequestTimeout:
    return events.RequestTimeout(line, 7, device, 3, 101.0, 100.0, "")


def rejected(host: str, port: int = 5) -> events.ClientRejected:
    return events.ClientRejected("scada", f"{host}:{port}", "too many clients")


def restarted(last: LastEvents) -> LastEvents:
    """What another run reads."""
    again = LastEvents(last._clock)
    again.load([read_row(*each.row()) for each in last.all()])
    return again


def test_an_event_is_kept_with_its_time_and_in_words(last, clock):
    last.add(LOST)
    (kept,) = last.all()
    assert (kept.name, kept.level, kept.times) == ("line_lost", events.Level.WARNING, 1)
    assert kept.first_at == kept.last_at == clock.now
    assert kept.text == "line hall is down: unplugged"
    assert kept.fields == LOST.fields()


def test_what_is_only_for_debugging_is_not_kept(last):
    last.add(events.ClientConnected("scada", "10.2.0.7:5"))
    assert last.all() == []


def test_a_traceback_is_not_kept_and_long_texts_are_cut(last):
    add(last, events.PartFailed("line", "E" * 5000, "T" * 5000))
    (kept,) = last.all()
    assert "traceback" not in kept.fields
    assert len(kept.text) < 500
    assert kept.size < 1500


def test_words_are_one_line(last):
    add(last, events.ConfigWarning("a key\n  is unknown", "did you mean\nthis?"))
    assert last.all()[0].text == "a key is unknown; did you mean this?"


def test_many_names_are_cut(last):
    add(last, events.ConfigApplied("f", tuple(f"line {number}" for number in range(100)), (), (), ()))
    assert last.all()[0].fields["added"][-1] == "and 80 more"


def test_the_first_ones_about_the_same_thing_stand_by_themselves_and_others_are_counted(last, clock):
    begun = clock.now
    add(last, *[timeout("press")] * 20, timeout("oven"))
    kept = last.all()
    assert [each.times for each in kept] == [1] * (MOST_ALIKE - 1) + [20 - MOST_ALIKE + 1, 1]
    counted = kept[-2]
    assert (counted.first_at, counted.last_at) == (begun + MOST_ALIKE - 1, begun + 19)


def test_an_event_that_stands_for_many_counts_as_many(last):
    add(last, *[events.QueueFull("hall", 7, "press", "10.2.0.7:5", times) for times in (None, 30, None, 20, None, 40)])
    assert [each.times for each in last.all()] == [1, 30, 1, 20, 41]


def test_after_an_hour_they_stand_by_themselves_again(last):
    add(last, *[timeout("press")] * 20, by=ALIKE_FOR / 19.5)
    last.add(timeout("press"))
    assert [each.times for each in last.all()][-1] == 1


def test_a_client_is_its_host(last):
    add(last, *(rejected("10.2.0.7", port) for port in range(20)))
    assert len(last.all()) == MOST_ALIKE


def test_writes_to_different_addresses_are_different_things(last):
    add(last, *(events.WriteAudit("10.2.0.7:5", "scada", 7, 6, at, 1, "ok", "", 1.0) for at in range(20)))
    assert len(last.all()) == 20


def test_clients_of_any_number_of_addresses_are_told_together(last):
    add(last, *(rejected(f"10.2.{number // 250}.{number % 250}") for number in range(5000)), by=0.001)
    kept = last.all()
    assert len(kept) == MOST_OF_A_KIND + 1
    assert sum(each.times for each in kept) == 5000
    assert kept[-1].text.startswith("others, such as: scada has closed the connection of 10.2.0.100")


def test_what_happens_seldom_is_not_displaced(last):
    add(last, LOST, REOPENED)
    for lap in range(60):
        add(last, *(timeout(f"press-{lap}-{number}") for number in range(90)), by=OF_A_KIND_FOR / 89.5)
    assert names(last)[:2] == ["line_lost", "line_reopened"]
    assert 0.9 * MOST_EVENTS <= len(last.all()) <= MOST_EVENTS
    assert last.all()[-1].fields["device"] == "press-59-89"


def test_the_room_is_bounded(last):
    for lap in range(30):
        add(
            last,
            *(events.ConfigWarning(f"{lap} {number} " + "x" * 2000, "y" * 2000) for number in range(90)),
            by=OF_A_KIND_FOR / 89.5,
        )
    kept = last.all()
    assert sum(len(each.row()[1]) for each in kept) <= MOST_BYTES + 1000 * len(str(MOST_EVENTS))
    assert len(kept) > 100


def test_a_clock_that_is_set_back_begins_anew(last, clock):
    add(last, *[timeout("press")] * 10)
    clock.now -= 5000
    last.add(timeout("press"))
    assert len(last.all()) == MOST_ALIKE + 1


# --- since when something is wrong ------------------------------------------------------------------


def test_something_is_wrong_since_the_first_event_after_it_was_right(last, clock):
    add(last, LOST, REOPENED, by=10)
    begun = clock.now
    add(last, LOST, LOST, LOST, by=10)
    assert last.began("line hall") == begun
    assert last.began("line yard") is None
    add(last, REOPENED)
    assert last.began("line hall") is None


def test_it_is_so_too_where_events_are_only_counted(last, clock):
    for _ in range(10):
        add(last, LOST, REOPENED)
    begun = clock.now
    add(last, LOST)
    assert last.began("line hall") == begun


def test_a_line_is_down_over_a_restart_and_a_unit_is_not(last, clock):
    begun = clock.now
    add(last, LOST, events.UnitResting("hall", 7, "press", 2.0, ""), by=10)
    assert last.began("unit press") == begun + 10
    last = restarted(last)
    add(last, events.ConfigLoaded("f", 1, 1), LOST)
    assert last.began("line hall") == begun
    assert last.began("unit press") is None


@pytest.mark.parametrize(
    ("begins", "ends", "about"),
    [
        (LOST, events.LineUp("hall", "/dev/hall"), "line hall"),
        (events.UnitResting("hall", 7, "press", 2.0, ""), events.UnitRecovered("hall", 7, "press"), "unit press"),
        (events.BrokerLost("mqtt://b:1883", "no"), events.BrokerUp("mqtt://b:1883", "5"), "broker mqtt://b:1883"),
        (events.FleetLost("nats://b", "no"), events.FleetUp("nats://b"), "fleet nats://b"),
        (events.ConfigRejected("f", "no"), events.ConfigApplied("f", (), (), (), ()), "config"),
        (events.StateNotKept("f", "full"), events.StateKeptAgain("f"), "state"),
    ],
    ids=lambda each: getattr(each, "name", each),
)
def test_each_trouble_has_its_end(last, begins, ends, about):
    add(last, begins)
    assert last.began(about) is not None
    add(last, ends)
    assert last.began(about) is None


# --- the file ---------------------------------------------------------------------------------------


def test_what_an_earlier_run_has_kept_comes_first(last):
    add(last, LOST, *[timeout("press")] * 20)
    before = last.all()
    ours = LastEvents(last._clock)
    add(ours, *[timeout("press")] * 7, REOPENED)
    ours.changes()
    ours.load([read_row(*each.row()) for each in before])
    add(ours, timeout("press"))
    assert names(ours) == ["line_lost", *["request_timeout"] * (2 * MOST_ALIKE - 1), "line_reopened", "request_timeout"]
    assert sorted(each.number for each in ours.all()) == list(range(1, 2 + 2 * MOST_ALIKE + 1))
    assert ours.all()[-1].times == 4
    assert ours.all()[0]._replace(changed=0, size=0) == before[0]._replace(changed=0, size=0)


def test_only_what_has_changed_is_written_and_mere_counts_seldom(last, clock):
    add(last, LOST, *[timeout("press")] * MOST_ALIKE)
    assert len(last.changes().written) == 1 + MOST_ALIKE
    assert not last.changes().written
    add(last, timeout("press"))
    clock.now += COUNTS_EVERY - 10
    assert not last.changes().written
    clock.now += 10
    (counted,) = last.changes().written
    assert counted.times == 2
    add(last, timeout("press"))
    last.count_now()
    assert [each.times for each in last.changes().written] == [3]


def test_a_new_event_brings_the_counts_along(last):
    add(last, *[timeout("press")] * MOST_ALIKE)
    last.changes()
    add(last, timeout("press"), LOST)
    assert [each.name for each in last.changes().written] == ["request_timeout", "line_lost"]


def test_what_is_dropped_goes_from_the_file_too(last):
    add(last, LOST)
    last.changes()
    gone = set()
    for lap in range(20):
        add(last, *(timeout(f"press-{lap}-{number}") for number in range(90)), by=OF_A_KIND_FOR / 89.5)
        changes = last.changes()
        gone |= changes.gone
        last.put_back(changes)
        again = last.changes()
        assert ([each.number for each in again.written], again.gone) == (
            [each.number for each in changes.written],
            changes.gone,
        )
    assert gone == set(range(1, last._number + 1)) - {each.number for each in last.all()}
    last.change_all()
    assert len(last.changes().written) == len(last.all())


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", "7", '{"other": 1}', "[" * 100_000, json.dumps({"first_at": "x"})],
    ids=range(7),
)
def test_what_is_no_event_is_not_read(content):
    with pytest.raises(ValueError):  # noqa: PT011 - any of its kinds
        read_row(1, content)


def test_a_row_with_a_field_of_another_type_is_not_read(last):
    last.add(LOST)
    number, content = last.all()[0].row()
    for name, wrong in {"first_at": "x", "times": "x", "level": None, "name": 7, "text": None, "fields": 7}.items():
        with pytest.raises(ValueError):  # noqa: PT011 - any of its kinds
            read_row(number, json.dumps({**json.loads(content), name: wrong}))


def test_a_storm_of_equal_events_costs_no_memory(last):
    for _ in range(3):
        add(last, *(rejected(f"10.{number % 7}.0.{number % 200}", number) for number in range(3000)), by=0.001)
        last._clock.now += ALIKE_FOR
    assert len(last._subjects) <= module._MOST_SUBJECTS
    assert len(last._recent) == 1
