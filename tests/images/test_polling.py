"""Polls of a device for several readers, answer by answer."""

import pytest

from gateway.errors import QueueFull
from gateway.events import PollRefused
from gateway.images.polled_range import Part, PollCounts
from gateway.images.polling import RETRY, TOGETHER_AGAIN, UNSENT_PAUSE, DevicePolls, PolledUnit
from gateway.images.polls import Poll
from gateway.images.turns import LONGEST_WAIT, MOST_POLLS, PollTurns
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.read_rules import ReadRules
from gateway.request import Caller, Origin

#: The registers of a meter have their addresses as values.
REGISTERS = b"".join(address.to_bytes(2, "big") for address in range(300))


class Reader:
    """Someone who wants ranges of holding registers, such as (0, 9), and what came of it."""

    def __init__(self, *ranges, every=1.0, label="mqtt"):
        self.counts, self.label, self.place = PollCounts(), label, "gateway.toml:9"
        self.parts = [Part(Poll(Area.HOLDING, first, last, every), self) for first, last in ranges]
        self.came = []

    def took(self, items, now):
        for part, own in items:
            assert own == REGISTERS[2 * part.poll.first : 2 * part.poll.last + 2]
        self.came.append([part.poll.first for part, _ in items])

    def missed(self, parts, now, *, answers):
        self.came.append(answers)

    def settle(self, parts, now):
        pass

    def take(self):
        """What came since the last call."""
        came, self.came = self.came, []
        return came


class Meter(Origin):
    """A device that is polled over gaps of two registers, the origin of its polls, and a clock."""

    def __init__(self, *readers, turns=None):
        self.caller = Caller.without_address("polls of meter")
        self.holes, self.asked, self.events = Holes(), [], []
        self.is_resting_until = 0.0
        unit = PolledUnit("meter", 41, ReadRules(max_gap=2))
        self.polls = DevicePolls(unit, self, self, turns or PollTurns(), self.events.append)
        for reader in readers:
            self.change(reader.parts)

    def change(self, come=(), gone=(), now=0.0):
        self.polls.change(come, gone, now)

    def submit(self, request, now, *, yields=False):
        assert yields
        self.asked.append(request)

    def is_resting(self, now):
        return now < self.is_resting_until

    def wants(self, request):
        return self.polls.wants(request)

    def answer(self, request, pdu):
        self.asked.remove(request)
        self.polls.polled(request, pdu, self.now)

    def at(self, now):
        """Let time pass; the addresses that are asked for then."""
        self.polls.tick(now)
        return [addresses(request) for request in self.asked]

    def answers(self, asked, now, *, code=None, error=None):
        """Answer the poll of these addresses: with the values, with an exception, or not at all."""
        request = next(each for each in self.asked if addresses(each) == asked)
        self.now, (first, last) = now, asked
        if error is not None:
            request.fail(error)
        else:
            items = REGISTERS[2 * first : 2 * last + 2]
            self.answer(request, bytes((3, len(items))) + items if code is None else bytes((0x83, code)))

    def round(self, now, **how):
        """Let time pass and answer all polls; the addresses that were asked for."""
        found = self.at(now)
        for asked in found:
            self.answers(asked, now, **how)
        return sorted(found)


def addresses(request):
    start, count = int.from_bytes(request.pdu[1:3], "big"), int.from_bytes(request.pdu[3:], "big")
    return (start, start + count - 1)


def points(*places, **options):
    return Reader(*((place, place) for place in places), **options)


# Joined polls


def test_what_several_want_is_one_request_and_each_gets_its_own():
    mqtt, mirror = points(0, 3, 5), Reader((2, 4), (5, 5), label="mirror silo")
    meter = Meter(mqtt, mirror)
    assert meter.round(0.0) == [(0, 5)]
    assert (mqtt.take(), mirror.take()) == ([[0, 3, 5]], [[2, 5]])
    assert mqtt.counts == mirror.counts == PollCounts(polls=1, failed=0)
    assert meter.polls.readers == (mqtt, mirror)
    assert meter.round(0.9) == []
    assert meter.round(1.0) == [(0, 5)]


def test_other_intervals_are_other_requests():
    meter = Meter(points(0), points(0, 1, every=2.0), points(0, every=0.5))
    assert [meter.round(at / 2) for at in range(5)] == [
        [(0, 0), (0, 0), (0, 1)],
        [(0, 0)],
        [(0, 0), (0, 0)],
        [(0, 0)],
        [(0, 0), (0, 0), (0, 1)],
    ]


def test_a_poll_that_is_due_while_the_one_before_is_in_progress_is_sent_right_after_it():
    meter = Meter(points(0))
    meter.at(0.0)
    assert meter.at(2.5) == [(0, 0)]
    meter.answers((0, 0), 2.6)
    assert meter.polls.deadline() == 1.0
    assert meter.round(2.6) == [(0, 0)]
    assert meter.polls.deadline() == 3.0, "and then at its interval again"


def test_an_older_poll_that_is_answered_later_changes_nothing():
    reader = points(0)
    meter = Meter(reader)
    assert meter.at(0.0) == [(0, 0)]
    meter.change(points(3).parts, now=0.1)
    assert meter.at(0.1) == [(0, 0), (0, 3)]
    meter.answers((0, 3), 0.2)
    meter.answers((0, 0), 0.3)
    assert reader.take() == [[0], []]
    assert reader.parts[0].sampled_at == 0.1


def test_few_polls_are_at_a_line_at_once_and_the_others_come_in_turn():
    turns = PollTurns()
    one, other = (Meter(Reader(*((at, at) for at in range(0, 80, 8))), turns=turns) for _ in range(2))
    assert len(one.at(0.0)) == 10
    assert len(other.at(0.0)) == MOST_POLLS - 10
    one.answers((0, 0), 0.1)
    assert (len(one.asked), len(other.asked)) == (9, MOST_POLLS - 9)
    while one.asked or other.asked:
        for meter in (one, other):
            for asked in [addresses(request) for request in meter.asked]:
                meter.answers(asked, 0.2)
    assert len(one.at(1.0)) == 10, "all have given their turns back"


def test_a_range_has_one_poll_in_progress_also_after_a_write():
    reader = points(0)
    meter = Meter(reader)
    assert meter.round(0.0) == [(0, 0)]
    meter.polls.changed(Span(Area.HOLDING, 0, 1), 0.0)
    assert meter.at(0.0) == [(0, 0)]
    assert meter.at(2.5) == [(0, 0)], "the second that was due before the write"
    meter.answers((0, 0), 2.5)
    (part,) = reader.parts
    assert part.sampled_at == 0.0


def test_reads_do_not_wait_long_for_a_poll_that_has_no_turn_yet():
    turns, reader = PollTurns(), points(0)
    busy = Meter(Reader(*((at, at) for at in range(0, 8 * (MOST_POLLS + 4), 8))), turns=turns)
    meter = Meter(reader, turns=turns)
    assert (len(busy.at(0.0)), meter.at(0.0)) == (MOST_POLLS, [])
    (part,) = reader.parts
    busy.answers((0, 0), LONGEST_WAIT - 0.1)
    assert part.is_awaited
    busy.answers((8, 8), LONGEST_WAIT)
    assert not part.is_awaited
    while busy.asked:
        busy.answers(addresses(busy.asked[0]), LONGEST_WAIT)
    assert meter.at(LONGEST_WAIT) == [(0, 0)], "its turn comes all the same"


def test_what_was_written_is_polled_before_all_that_waits_at_the_line():
    turns = PollTurns()
    busy = Meter(Reader(*((at, at) for at in range(0, 8 * (MOST_POLLS + 4), 8))), turns=turns)
    meter = Meter(points(0, 10), turns=turns)
    assert meter.round(0.0) == [(0, 0), (10, 10)]
    assert len(busy.at(1.0)) == MOST_POLLS
    assert meter.at(1.0) == [], "it waits for its turn"
    meter.polls.changed(Span(Area.HOLDING, 10, 1), 1.1)
    assert meter.at(1.1) == [(10, 10)], "a client's read waits for it"
    meter.answers((10, 10), 1.2)
    assert meter.at(1.2) == []
    meter.polls.changed(Span(Area.HOLDING, 10, 1), 1.3)
    assert meter.at(1.3) == [(10, 10)]
    meter.answers((10, 10), 1.4)
    for asked in busy.at(1.4):
        busy.answers(asked, 1.5)
    assert (meter.at(1.5), len(busy.asked)) == ([(0, 0)], 4)
    for each in (meter, busy):
        for asked in each.at(1.5):
            each.answers(asked, 1.6)
    assert (len(busy.at(2.5)), meter.at(2.5)) == (MOST_POLLS, []), "all have given their turns back, and no more"


# Refused polls


def test_a_refused_poll_is_split_until_all_is_read_and_its_parts_stay():
    reader = points(0, 3, 6, 9)
    meter = Meter(reader)
    assert meter.at(0.0) == [(0, 9)]
    meter.answers((0, 9), 0.0, code=2)
    assert meter.at(0.0) == [(0, 3), (6, 9)]
    meter.answers((0, 3), 0.0)
    meter.answers((6, 9), 0.0, code=2)
    assert meter.at(0.0) == [(6, 6), (9, 9)]
    meter.answers((6, 6), 0.0)
    assert meter.holes.refused == ()
    meter.answers((9, 9), 0.0)
    assert reader.take() == [True, [0, 3], True, [6], [9]]
    assert [hole.addresses for hole in meter.holes.refused] == ["7-8", "4-5"]
    for second in range(1, 200):
        assert meter.round(float(second)) == [(0, 3), (6, 6), (9, 9)]
    assert meter.events == []


@pytest.mark.parametrize("code", [2, 3, 4])
def test_all_exceptions_that_may_refuse_addresses_split_a_poll_at_once(code):
    meter = Meter(Reader((0, 1), (2, 3)))
    assert meter.round(0.0, code=code) == [(0, 3)]
    assert meter.round(0.0) == [(0, 1), (2, 3)]
    assert meter.events == []


@pytest.mark.parametrize("code", [1, 6, 10, 11])
def test_no_other_exception_splits_a_poll(code):
    meter = Meter(Reader((0, 1), (2, 3)))
    meter.round(0.0, code=code)
    assert meter.round(1.0) == [(0, 3)]


def missing():
    """A meter without the point at 9; all others have been read."""
    reader = points(0, 3, 6, 9)
    meter = Meter(reader)
    meter.round(0.0, code=2)
    meter.at(0.0)
    meter.answers((0, 3), 0.0)
    meter.answers((6, 9), 0.0, code=2)
    meter.at(0.0)
    meter.answers((6, 6), 0.0)
    meter.answers((9, 9), 0.0, code=2)
    return meter, reader


def test_a_missing_point_is_told_once_and_its_parts_end_when_it_is_there():
    meter, reader = missing()
    [told] = meter.events
    assert told == PollRefused("mqtt", "meter", "holding 9", 2, "gateway.toml:9")
    assert sorted(meter.at(TOGETHER_AGAIN)) == [(0, 3), (0, 9), (6, 6), (6, 9), (9, 9)]
    reader.take()
    meter.answers((0, 9), TOGETHER_AGAIN)
    assert reader.take() == [[0, 3, 6, 9]]
    assert meter.holes.refused == ()
    # The others were under way; whatever comes for them changes nothing any more.
    meter.answers((6, 9), TOGETHER_AGAIN, code=2)
    meter.answers((0, 3), TOGETHER_AGAIN, code=2)
    meter.answers((6, 6), TOGETHER_AGAIN)
    meter.answers((9, 9), TOGETHER_AGAIN)
    assert meter.events == [told]
    assert meter.at(TOGETHER_AGAIN + 0.5) == []
    assert meter.at(TOGETHER_AGAIN + 1.0) == [(0, 9)]


def test_a_part_that_is_read_after_the_whole_was_says_nothing_of_the_hole():
    meter = Meter(points(0, 3, 6, 9))
    meter.round(0.0, code=2)
    meter.at(0.0)
    meter.answers((0, 3), 0.0)
    meter.at(TOGETHER_AGAIN)
    meter.answers((0, 9), TOGETHER_AGAIN)
    meter.answers((6, 9), TOGETHER_AGAIN)
    assert meter.holes.refused == ()


def half_refused():
    """A meter that refuses 0-9, and of its halves 6-9 for good; both are polled, and so is the whole again."""
    reader = Reader((0, 4), (6, 9), every=3600.0)
    meter = Meter(reader)
    meter.round(0.0, code=2)
    for now in (0.0, 3600.0):
        meter.at(now)
        meter.answers((0, 4), now)
        meter.answers((6, 9), now, code=2)
    assert meter.at(3600.0) == [(0, 9)]
    return meter, reader.parts[0]


def test_what_was_written_before_the_whole_is_read_again_is_polled_at_once():
    meter, written = half_refused()
    meter.polls.changed(Span(Area.HOLDING, 0, 1), 3600.1)
    meter.answers((0, 9), 3600.2)
    assert written.is_urgent, "that poll was sent before"
    assert meter.round(3600.2) == [(0, 9)]
    assert not written.is_urgent
    assert meter.polls.deadline() == 7200.2


def test_the_whole_that_is_refused_again_ends_no_wait_for_its_parts():
    meter, written = half_refused()
    meter.polls.changed(Span(Area.HOLDING, 0, 1), 3600.1)
    meter.at(3600.1)
    meter.answers((0, 9), 3600.2, code=2)
    assert not written.is_lost(3600.2, 10.0, 1)
    meter.answers((0, 4), 3600.3)
    assert written.is_known(1)


# Polls without an answer


def test_after_a_poll_without_an_answer_the_next_one_does_not_wait_for_a_long_interval():
    reader = points(0, every=60.0)
    meter = Meter(reader)
    meter.round(0.0, code=11)
    assert reader.take() == [False]
    assert meter.polls.deadline() == RETRY
    meter.round(RETRY)
    assert meter.polls.deadline() == RETRY + 60.0


def test_a_poll_that_the_line_does_not_take_is_no_failure_of_the_device_and_repeated():
    reader = points(0, every=60.0)
    meter = Meter(reader)
    meter.at(0.0)
    meter.answers((0, 0), 0.0, error=QueueFull())
    assert reader.take() == [None]
    assert reader.counts == PollCounts(polls=1, failed=1)
    assert meter.polls.deadline() == RETRY


def test_a_device_that_says_it_is_busy_has_answered_and_is_asked_again_after_a_pause():
    reader = points(0, every=0.1)
    meter = Meter(reader)
    meter.round(0.0, code=6)
    assert reader.take() == [True]
    assert meter.polls.deadline() == UNSENT_PAUSE


def test_a_device_that_backs_off_is_not_asked_and_its_readers_are_told_at_each_interval():
    reader = points(0)
    meter = Meter(reader)
    meter.is_resting_until = 1.5
    assert [meter.round(at) for at in (0.0, 1.0, 2.0)] == [[], [], [(0, 0)]]
    assert reader.take() == [False, False, [0]]
    assert reader.counts == PollCounts(polls=1, failed=0)


# Writes


def test_after_a_write_all_is_polled_again_and_what_was_written_is_unknown_until_then():
    reader = points(0, 20, every=60.0)
    meter = Meter(reader)
    meter.round(0.0)
    meter.polls.changed(Span(Area.HOLDING, 20, 2), 1.0)
    assert [part.age(1.0) for part in reader.parts] == [1.0, None]
    assert meter.round(1.0) == [(0, 0), (20, 20)]
    assert [part.age(2.0) for part in reader.parts] == [1.0, 1.0]
    assert meter.polls.deadline() == 61.0


def test_a_poll_that_was_sent_before_the_write_had_finished_does_not_count():
    reader = points(0, every=60.0)
    meter = Meter(reader)
    meter.at(0.0)
    meter.polls.changed(Span(Area.HOLDING, 0, 1), 0.5)
    meter.answers((0, 0), 0.6)
    assert reader.parts[0].age(0.6) is None
    assert meter.round(0.6) == [(0, 0)]
    assert reader.parts[0].age(0.6) == 0.0


def test_many_writes_leave_nothing_behind_that_grows():
    seldom, often = points(0, every=3600.0), points(10)
    meter = Meter(seldom, often)
    for write in range(1000):
        meter.polls.changed(None, float(write))
        assert meter.round(float(write)) == [(0, 0), (10, 10)]
    assert len(meter.polls._due) < 100
    meter.change((), often.parts, 999.0)
    assert meter.polls.deadline() == 999.0 + 3600.0


class AtOnce(Meter):
    """What answers each poll before the next one is sent, as an image does."""

    now = 0.0

    def submit(self, request, now, *, yields=False):
        super().submit(request, now, yields=yields)
        self.answers(addresses(request), now)


def test_many_writes_to_what_answers_at_once_leave_nothing_behind_that_grows():
    meter = AtOnce(points(0, every=3600.0), points(10))
    for write in range(1000):
        meter.polls.changed(None, float(write))
        meter.at(float(write))
    assert len(meter.polls._due) < 100
    assert meter.polls.deadline() == 1000.0


# Readers that come and go


def test_who_stays_keeps_values_and_intervals():
    stays, goes, comes = points(0, 1, every=10.0), points(2, 20, every=10.0), points(30, every=10.0)
    meter = Meter(stays, goes)
    meter.round(0.0)
    meter.change(comes.parts, goes.parts, 4.0)
    assert [part.age(4.0) for part in stays.parts] == [4.0, 4.0]
    assert meter.round(4.0) == [(30, 30)], "at once, as nothing is known yet"
    assert meter.round(9.0) == []
    assert meter.round(10.0) == [(0, 1)]
    assert meter.round(14.0) == [(30, 30)]
    goes.take()
    meter.change((), stays.parts, 14.0)
    assert meter.round(20.0) == []
    assert goes.take() == []


def test_what_joins_a_poll_is_read_at_once_and_then_with_it():
    stays, comes = points(0, every=10.0), points(1, every=10.0)
    meter = Meter(stays)
    meter.round(0.0)
    meter.change(comes.parts, (), 4.0)
    assert meter.round(4.0) == [(0, 1)]
    assert meter.polls.deadline() == 14.0


def test_after_a_write_all_is_polled_again_at_once_also_if_readers_come_or_go_before():
    stays = points(0, 1, every=10.0)
    meter = Meter(stays)
    meter.round(0.0)
    meter.polls.changed(Span(Area.HOLDING, 20, 1), 4.0)
    meter.change((), stays.parts[1:], 4.0)
    assert meter.round(4.0) == [(0, 0)]
    assert meter.round(4.0) == []


def test_a_refused_poll_that_stays_as_it_is_is_not_tried_nor_told_again():
    meter, before = missing()
    after = points(0, 3, 6, 9)
    meter.change(after.parts, before.parts, 0.5)
    before.take()
    assert sorted(meter.at(0.5)) == [(0, 3), (6, 6), (9, 9)]
    meter.answers((9, 9), 0.5, code=2)
    meter.answers((6, 6), 0.5)
    meter.answers((0, 3), 0.5)
    assert (before.take(), after.take()) == ([], [True, [6], [0, 3]])
    assert meter.round(1.5) == [(0, 3), (6, 6), (9, 9)]
    assert len(meter.events) == 1


def test_a_poll_in_progress_that_stays_as_it_is_goes_on_for_those_who_came():
    before, after = points(0, every=10.0), points(0, every=10.0)
    meter = Meter(before)
    meter.at(0.0)
    [poll] = meter.asked
    meter.change(after.parts, before.parts, 0.1)
    assert meter.wants(poll)
    assert meter.at(0.1) == [(0, 0)]
    meter.answers((0, 0), 0.2)
    assert (before.take(), after.take()) == ([], [[0]])
    assert meter.polls.deadline() == 10.0


def test_a_poll_that_waits_is_sent_in_its_new_form_at_once():
    stays, goes = points(0, every=10.0), points(1, every=10.0)
    meter = Meter(stays, goes)
    meter.round(0.0)
    meter.at(10.0)
    [poll] = meter.asked
    meter.change((), goes.parts, 10.1)
    assert not meter.wants(poll)
    meter.now = 10.2
    meter.answer(poll, None)  # dropped, as nobody wants it
    assert stays.take() == [[0]]
    assert meter.round(10.2) == [(0, 0)]
    assert (stays.take(), goes.take()) == ([[0]], [[1]])
