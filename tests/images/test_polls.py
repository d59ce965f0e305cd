import pytest

from gateway.images.polls import Poll, cut, joined, polling_function
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.read_rules import NO_RULES, ReadRules


def holding(first: int, last: int, every: float = 1.0) -> Poll:
    return Poll(Area.HOLDING, first, last, every)


def runs(polls, limits=None, **rules):
    return [str(poll) for poll in joined(polls, ReadRules(limits or {}, **rules), Holes())]


def pieces(polls, limits=None):
    return [str(poll) for poll in cut(polls, ReadRules(limits or {}))]


def test_neighbours_with_one_pace_are_read_together():
    assert runs([holding(2, 9), holding(0, 1), holding(10, 10)]) == ["holding 0-10"]


def test_a_hole_another_pace_or_another_area_parts_them():
    assert runs([holding(0, 1), holding(3, 4)]) == ["holding 0-1", "holding 3-4"]
    assert runs([holding(0, 1), holding(2, 4, every=2.0)]) == ["holding 0-1", "holding 2-4"]
    assert runs([holding(0, 1), Poll(Area.INPUT, 2, 4, 1.0)]) == ["holding 0-1", "input 2-4"]


def test_no_read_is_longer_than_the_device_takes():
    assert runs([holding(0, 9), holding(10, 19)], {3: 15}) == ["holding 0-9", "holding 10-19"]
    assert runs([holding(0, 9), holding(10, 14)], {3: 15}) == ["holding 0-14"]
    assert pieces([holding(0, 249)], {3: 99}) == ["holding 0-98", "holding 99-197", "holding 198-249"]


def test_no_read_is_longer_than_the_protocol_takes():
    assert pieces([holding(0, 125)]) == ["holding 0-124", "holding 125"]
    assert pieces([Poll(Area.COILS, 0, 2000, 1.0)]) == ["coils 0-1999", "coils 2000"]
    assert runs([holding(0, 99), holding(100, 199)]) == ["holding 0-99", "holding 100-199"]


def test_equal_polls_are_one_and_overlapping_ones_are_read_together_as_far_as_they_fit():
    assert runs([holding(0, 3), holding(0, 3)]) == ["holding 0-3"]
    assert runs([holding(0, 3), holding(2, 5), holding(1, 2)]) == ["holding 0-5"]
    assert runs([holding(0, 99), holding(90, 130)]) == ["holding 0-99", "holding 90-130"]
    assert runs([holding(0, 3), holding(0, 3, every=2.0)]) == ["holding 0-3", "holding 0-3"]


def test_wide_registers_are_read_apart_from_others():
    polls = [holding(0, 1), Poll(Area.HOLDING, 2, 3, 1.0, width=4), Poll(Area.HOLDING, 4, 70, 1.0, width=4)]
    assert runs(polls) == ["holding 0-1", "holding 2-3", "holding 4-70"]


def test_a_joined_read_knows_what_it_was_joined_from():
    (poll,) = joined([holding(0, 1), holding(2, 3), holding(4, 5)], NO_RULES, Holes())
    assert poll.parts == (holding(0, 1), holding(2, 3), holding(4, 5))
    (alone,) = joined([holding(0, 1)], NO_RULES, Holes())
    assert alone.parts == ()


@pytest.mark.parametrize(
    ("area", "function", "request_pdu"),
    [
        (Area.COILS, 1, "01 0010 0003"),
        (Area.DISCRETE, 2, "02 0010 0003"),
        (Area.HOLDING, 3, "03 0010 0003"),
        (Area.INPUT, 4, "04 0010 0003"),
    ],
)
def test_each_area_has_its_function(area, function, request_pdu):
    assert polling_function(area) == function
    assert Poll(area, 0x10, 0x12, 1.0).request == bytes.fromhex(request_pdu)


def test_ranges_are_joined_over_as_many_addresses_as_the_profile_allows():
    polls = [holding(0, 1), holding(4, 5), holding(9, 9)]
    assert runs(polls, max_gap=1) == ["holding 0-1", "holding 4-5", "holding 9"]
    assert runs(polls, max_gap=2) == ["holding 0-5", "holding 9"]
    assert runs(polls, max_gap=3) == ["holding 0-9"]
    assert runs(polls, {3: 8}, max_gap=3) == ["holding 0-5", "holding 9"]
    assert runs(polls, max_gap=3, areas={Area.HOLDING: ((0, 6), (8, 9))}) == ["holding 0-5", "holding 9"]


def test_a_poll_over_holes_knows_what_is_declared_and_is_split_at_them_first():
    (poll,) = joined([holding(0, 1), holding(2, 2), holding(5, 6), holding(9, 9)], ReadRules(max_gap=2), Holes())
    assert [str(each) for each in poll.wanted] == ["holding 0-1", "holding 2", "holding 5-6", "holding 9"]
    assert poll.bridged == 4
    assert [str(part) for part in poll.parts] == ["holding 0-6", "holding 9"]
    assert [str(part) for part in poll.parts[0].parts] == ["holding 0-2", "holding 5-6"]
    assert [str(part) for part in poll.parts[0].parts[0].parts] == ["holding 0-1", "holding 2"]
    assert poll.parts[1] == holding(9, 9)


def test_what_the_device_has_refused_is_not_polled_over():
    holes = Holes()
    holes.add(Span(Area.HOLDING, 3, 2))
    polls = joined([holding(0, 2), holding(5, 6), holding(9, 9)], ReadRules(max_gap=2), holes)
    assert [str(poll) for poll in polls] == ["holding 0-2", "holding 5-9"]
