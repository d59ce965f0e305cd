"""The events that the demo makes up: those of the day that it makes up, and none of them is still true."""

from gateway.cli.demo.past import made_up_events
from gateway.events import Level
from gateway.observe.last_events import LastEvents


def test_they_are_of_the_day_before_and_in_its_order(plan, now):
    times = [event.first_at for event in made_up_events(plan, now)]
    assert times == sorted(times)
    assert now - 24 * 3600 < times[0] < times[-1] < now - 3600


def test_what_was_wrong_has_ended(plan, now):
    """Else a page would say that it is wrong since then."""
    last = LastEvents(lambda: now)
    last.load(made_up_events(plan, now))
    begun = [event.begins for event in last.all() if event.begins]
    assert {"line yard", "unit oven"} <= set(begun)
    assert [about for about in begun if last.began(about) is not None] == []


def test_they_are_there_when_the_pages_show_that_time_as_troubled(plan, now, day):
    down = [slot.number for slot in day if slot.lines["yard"].down]
    (lost,) = (event for event in made_up_events(plan, now) if event.name == "line_lost")
    assert lost.level == Level.WARNING
    assert abs(lost.first_at - down[0] * 600) <= 600
