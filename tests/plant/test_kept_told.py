"""What is told of kept values: how many are given up and why, when all are sent, and when the room is used up."""

from gateway.events import KeptValuesSent, ValuesGivenUp
from gateway.plant.kept.given_up import GivenUp
from gateway.plant.kept.progress import Progress


class Clock:
    """A clock that is set by hand, and the events of what has it."""

    def __init__(self) -> None:
        self.time = 1000.0
        self.events = []

    def told(self):
        events = self.events.copy()
        self.events.clear()
        return events


def given_up():
    clock = Clock()
    return clock, GivenUp(clock.events.append, lambda: clock.time)


def progress():
    clock = Clock()
    return clock, Progress(clock.events.append, lambda: clock.time)


def test_values_that_are_given_up_are_told_at_once_and_then_once_a_minute():
    clock, values = given_up()
    assert values.age is None
    values.add(3, "full")
    assert clock.told() == [ValuesGivenUp(3, "full")]
    for _ in range(5):
        clock.time += 10.0
        values.add(2, "full")
        values.tell()
    assert clock.told() == []
    assert (values.values, values.age) == (13, 0.0)
    clock.time += 10.0
    values.tell()
    assert clock.told() == [ValuesGivenUp(10, "full")]
    clock.time += 600.0
    values.tell()
    assert clock.told() == []
    assert values.age == 610.0


def test_each_reason_is_told_and_what_was_not_told_at_the_end_at_the_latest():
    clock, values = given_up()
    values.add(0, "nothing")
    assert clock.told() == []
    values.add(1, "full")
    values.add(2, "full")
    values.add(4, "damaged")
    values.tell(is_last=True)
    assert clock.told() == [ValuesGivenUp(1, "full"), ValuesGivenUp(2, "full"), ValuesGivenUp(4, "damaged")]


def test_it_is_told_once_in_a_connection_that_all_was_sent():
    clock, sending = progress()
    sending.begin()
    sending.left(0)
    assert clock.told() == [], "nothing was sent"
    sending.sent(100)
    sending.left(50)
    clock.time += 4.1
    sending.sent(50)
    sending.left(0)
    assert clock.told() == [KeptValuesSent(150, 4.1)]
    sending.sent(1)
    sending.left(0)
    assert clock.told() == []
    sending.begin()
    sending.sent(7)
    sending.left(0)
    assert clock.told() == [KeptValuesSent(7, 0.0)]


def test_nothing_is_said_to_be_sent_if_the_broker_has_refused_all():
    clock, sending = progress()
    sending.begin()
    sending.sent(0)
    sending.left(0)
    assert clock.told() == []


def test_how_long_the_room_lasts_is_known_after_a_minute_in_which_nothing_was_sent():
    clock, filling = progress()
    filling.written(1000)
    clock.time += 50.0
    filling.written(1500)
    assert filling.full_in(1500, 3000) is None
    clock.time += 50.0
    filling.written(2000)
    assert filling.full_in(2000, 3000) == 100.0
    assert filling.full_in(3100, 3000) == 0.0
    filling.sent(1)
    assert filling.full_in(2000, 3000) is None
    filling.written(2000)
    clock.time += 100.0
    assert filling.full_in(2000, 3000) is None, "it does not grow"
