"""Reads of published points over holes, answer by answer."""

from gateway.events import PollRefused
from gateway.modbus.codes import Area
from gateway.plant.polls import TOGETHER_AGAIN, Polls
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.profiles.read_rules import ReadRules
from gateway.request import Caller


class Meter:
    """A device with points at 0, 3, 6 and 9, the origin of its reads, and a clock."""

    caller = Caller.without_address("mqtt")

    def __init__(self):
        points = tuple(PublishedPoint(Point(f"p{at}", Area.HOLDING, at), 1.0) for at in (0, 3, 6, 9))
        device = PublishedDevice("meter", 41, "hall", "Meter", points, ReadRules(max_gap=2))
        self.holes, self.asked, self.events = Holes(), [], []
        self.polls = Polls([device], {"meter": self}, self, self.events.append, "gateway.toml:9", 0.0)

    def submit(self, request, now, *, yields=False):
        self.asked.append(request)

    def is_resting(self, now):
        return False

    def wants(self, request):
        return True

    def at(self, now):
        """Let time pass; the addresses that are asked for then."""
        self.polls.tick(now)
        return [self._addresses(request) for request in self.asked]

    def answers(self, addresses, now, *, refuses=False):
        """Answer the read of these addresses."""
        request = next(each for each in self.asked if self._addresses(each) == addresses)
        self.asked.remove(request)
        count = int.from_bytes(request.pdu[3:], "big")
        response = bytes((0x83, 2)) if refuses else bytes((3, 2 * count)) + bytes(2 * count)
        return self.polls.answered(request, response, now).values.keys()

    @staticmethod
    def _addresses(request):
        start, count = int.from_bytes(request.pdu[1:3], "big"), int.from_bytes(request.pdu[3:], "big")
        return (start, start + count - 1)


def test_a_refused_read_is_split_until_all_is_read_and_its_parts_stay():
    meter = Meter()
    assert meter.at(0.0) == [(0, 9)]
    meter.answers((0, 9), 0.0, refuses=True)
    assert meter.at(0.0) == [(0, 3), (6, 9)]
    assert meter.answers((0, 3), 0.0) == {"p0", "p3"}
    meter.answers((6, 9), 0.0, refuses=True)
    assert meter.at(0.0) == [(6, 6), (9, 9)]
    meter.answers((6, 6), 0.0)
    assert meter.holes.refused == ()
    meter.answers((9, 9), 0.0)
    assert [hole.addresses for hole in meter.holes.refused] == ["7-8", "4-5"]
    for second in range(1, 200):
        assert sorted(meter.at(float(second))) == [(0, 3), (6, 6), (9, 9)]
        for addresses in [(0, 3), (6, 6), (9, 9)]:
            meter.answers(addresses, second + 0.1)
    assert meter.events == []


def missing():
    """A meter without the point at 9, one round before its points are read together again."""
    meter = Meter()
    meter.at(0.0)
    meter.answers((0, 9), 0.0, refuses=True)
    meter.at(0.0)
    meter.answers((0, 3), 0.0)
    meter.answers((6, 9), 0.0, refuses=True)
    meter.at(0.0)
    meter.answers((6, 6), 0.0)
    meter.answers((9, 9), 0.0, refuses=True)
    return meter


def test_a_missing_point_is_told_once_and_its_parts_end_when_it_is_there():
    meter = missing()
    assert [(type(event), event.addresses) for event in meter.events] == [(PollRefused, "holding 9")]
    assert sorted(meter.at(TOGETHER_AGAIN)) == [(0, 3), (0, 9), (6, 6), (6, 9), (9, 9)]
    assert meter.answers((0, 9), TOGETHER_AGAIN) == {"p0", "p3", "p6", "p9"}
    assert len(meter.events) == 1
    assert meter.holes.refused == ()
    # The others were under way; whatever comes for them changes nothing any more.
    meter.answers((6, 9), TOGETHER_AGAIN, refuses=True)
    meter.answers((0, 3), TOGETHER_AGAIN, refuses=True)
    meter.answers((6, 6), TOGETHER_AGAIN)
    meter.answers((9, 9), TOGETHER_AGAIN)
    assert len(meter.events) == 1
    assert meter.at(TOGETHER_AGAIN + 0.5) == []
    assert meter.at(TOGETHER_AGAIN + 1.0) == [(0, 9)]


def test_a_part_that_is_read_after_the_whole_was_says_nothing_of_the_hole():
    meter = Meter()
    meter.at(0.0)
    meter.answers((0, 9), 0.0, refuses=True)
    meter.at(0.0)
    meter.answers((0, 3), 0.0)
    meter.at(TOGETHER_AGAIN)
    meter.answers((0, 9), TOGETHER_AGAIN)
    meter.answers((6, 9), TOGETHER_AGAIN)
    assert meter.holes.refused == ()
