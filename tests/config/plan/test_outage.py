"""How long `keep` is enough: the fewer values and the more of them in a row, the longer."""

import pytest

from gateway.config.plan.add_ons import longest_outage
from gateway.config.plan.settings import MqttPlan
from gateway.config.values.broker import parse_broker
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint

KEEP = 2**20


def outage(*every, keep=KEEP, keep_every=10.0, **point):
    points = tuple(
        PublishedPoint(Point(f"p{number}", Area.HOLDING, number, **point), seconds)
        for number, seconds in enumerate(every)
    )
    device = PublishedDevice("silo", 1, "Silo", points)
    return longest_outage(MqttPlan("plant", parse_broker("mqtt://broker"), (device,), keep=keep, keep_every=keep_every))


def test_nothing_is_told_of_what_is_not_kept():
    assert outage(1.0, keep=0) is None
    assert outage() is None
    assert outage(1.0, write="only") is None


@pytest.mark.parametrize(("every", "rate"), [((1.0,), 1.0), ((1.0, 2.0, 0.5), 3.5), ((60.0,), 1 / 60)])
def test_the_rate_is_that_of_all_reads(every, rate):
    assert outage(*every).values_per_s == pytest.approx(rate)


def test_twice_the_room_lasts_twice_as_long():
    assert outage(1.0, keep=2 * KEEP).seconds == pytest.approx(2 * outage(1.0).seconds)


def test_few_values_need_more_room_each():
    together, alone = outage(*[1.0] * 100), outage(1.0)
    assert 3 < alone.seconds / together.seconds < 100, "a row has its own room, whatever is in it"


def test_rows_that_are_written_less_often_need_less_room():
    assert outage(1.0, keep_every=60.0).seconds > outage(1.0).seconds
    assert outage(60.0, keep_every=20.0).seconds == outage(60.0).seconds, "each has one value in any case"


def test_long_text_needs_more_room():
    number, text = outage(1.0), outage(1.0, type="string", count=32)
    assert text.seconds < number.seconds / 2
