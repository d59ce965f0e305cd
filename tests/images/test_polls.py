"""What is wanted of a device, joined into as few requests as it allows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.images.polls import Poll, apart, cut, in_a_row, joined, polling_function
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
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


def test_no_poll_goes_over_an_address_that_is_only_written():
    polls = [holding(0, 1), holding(4, 5), holding(9, 10)]
    only_written = (Span(Area.HOLDING, 3, 1), Span(Area.INPUT, 7, 1))
    assert runs(polls, max_gap=9, only_written=only_written) == ["holding 0-1", "holding 4-10"]


def test_what_is_more_than_was_refused_is_not_polled_and_a_part_of_it_may_be():
    holes = Holes()
    holes.add(Span(Area.HOLDING, 4, 2))
    rules = ReadRules(max_gap=9)
    polls = joined([holding(0, 0), holding(3, 3), holding(9, 9)], rules, holes)
    assert [str(poll) for poll in polls] == ["holding 0-3", "holding 9"]
    assert [str(poll) for poll in joined([holding(4, 4), holding(6, 6)], rules, holes)] == ["holding 4-6"]


def test_a_point_is_read_with_its_scale_and_what_lies_between():
    energy = Point("energy", Area.HOLDING, 10, "uint32", count=2, scale_at=16)
    (poll,) = joined([Poll.of(energy), holding(13, 13, every=0.0)], NO_RULES, Holes())
    assert (str(poll), poll.hole, poll.bridged) == ("holding 10-16", None, 0)
    assert [str(part) for part in poll.parts] == ["holding 10-16", "holding 13"]


def test_each_range_has_its_own_part_of_what_was_read():
    (poll,) = joined([holding(10, 10), holding(11, 12), holding(12, 12)], NO_RULES, Holes())
    items = bytes.fromhex("000A 000B 000C")
    assert [items[poll.place(each)].hex() for each in poll.wanted] == ["000a", "000b000c", "000c"]
    coils = [Poll(Area.COILS, address, address, 1.0) for address in (5, 6, 7)]
    (poll,) = joined(coils, NO_RULES, Holes())
    assert [b"\1\0\2"[poll.place(each)] for each in poll.wanted] == [b"\1", b"\0", b"\2"]
    (poll,) = joined([Poll(Area.HOLDING, at, at, 1.0, width=4) for at in (5, 6)], NO_RULES, Holes())
    assert [bytes(range(8))[poll.place(each)] for each in poll.wanted] == [bytes(range(4)), bytes(range(4, 8))]


POLLS = st.lists(
    st.builds(
        lambda area, first, count: Poll(area, first, first + count - 1, 1.0),
        st.sampled_from(Area),
        st.integers(0, 200),
        st.integers(1, 4),
    ),
    max_size=40,
)
RANGES = st.lists(st.integers(0, 203), min_size=2, max_size=8, unique=True).map(sorted)
RULES = st.builds(
    lambda gap, edges, most: ReadRules({3: most}, gap, {Area.HOLDING: (*zip(edges[::2], edges[1::2], strict=False),)}),
    st.integers(0, 12),
    RANGES,
    st.integers(4, 60),
)


def exists(rules, area, address):
    ranges = rules.areas.get(area)
    return ranges is None or any(first <= address <= last for first, last in ranges)


@given(POLLS, RULES)
def test_reads_have_every_range_once_and_no_hole_that_is_not_allowed(polls, rules):
    found = joined(polls, rules, Holes())
    assert sorted(map(str, set(polls))) == sorted(str(each) for poll in found for each in poll.wanted)
    for poll in found:
        read = range(poll.first, poll.last + 1)
        assert len(read) <= rules.most(poll.area)
        own = {address for each in poll.wanted for address in range(each.first, each.last + 1)}
        assert own <= set(read)
        assert all(exists(rules, poll.area, address) for address in set(read) - own)
        gaps = "".join(" " if address in own else "x" for address in read).split()
        assert max(map(len, gaps), default=0) <= rules.max_gap
        assert poll.bridged == sum(map(len, gaps))


@given(POLLS, RULES)
def test_there_are_as_few_reads_as_ranges_in_their_order_allow(polls, rules):
    def fewest(ordered):
        """Try every way to cut a list of ranges into reads."""
        best = [0]
        for end in range(1, len(ordered) + 1):
            starts = (start for start in range(end) if len([*joined(ordered[start:end], rules, Holes())]) == 1)
            best.append(1 + min(best[start] for start in starts))
        return best[-1]

    polls = sorted(set(polls), key=lambda poll: (poll.area, poll.first, poll.last))[:12]
    assert len([*joined(polls, rules, Holes())]) == fewest(polls)


@given(POLLS, RULES)
def test_the_parts_of_a_refused_read_have_its_ranges_and_end_with_single_ones(polls, rules):
    found = [*joined(polls, rules, Holes())]
    while found:
        poll = found.pop()
        parts = poll.parts
        assert parts or poll.wanted == (poll,)
        if parts:
            assert [each for part in parts for each in part.wanted] == list(poll.wanted)
            if poll.hole is not None:
                before, behind = parts
                assert (before.last + 1, behind.first) == (poll.hole.start, poll.hole.end)
            found += parts


def test_what_is_only_heard_is_kept_apart_but_for_what_is_one_value():
    together = [
        Span(Area.HOLDING, 2, 2),
        Span(Area.HOLDING, 3, 3),  # overlaps with the one before
        Span(Area.HOLDING, 9, 2),  # not all of it is wanted
        Span(Area.INPUT, 7, 2),
    ]
    pieces = [(each.first, each.last) for each in apart([holding(0, 9, 0.0)], together)]
    assert pieces == [(0, 0), (1, 1), (2, 5), (6, 6), (7, 7), (8, 8), (9, 9)]
    ranges = [holding(0, 9, 0.0), holding(12, 13, 0.0)]
    assert list(in_a_row(apart(ranges, together))) == ranges
