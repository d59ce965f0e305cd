"""Which requests read a number of points."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.batches import batches
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.read_rules import NO_RULES, ReadRules


def at(address, count=1, area=Area.HOLDING):
    return Point(f"{area}-{address}", area, address, count=count)


def spans(points, limits=None):
    return [batch.span for batch in batches(points, ReadRules(limits or {}), Holes())]


def test_neighbours_share_a_request_and_gaps_part_them():
    assert spans([at(4), at(0, 2), at(2, 2), at(6)]) == [Span(Area.HOLDING, 0, 5), Span(Area.HOLDING, 6, 1)]


def test_areas_have_requests_of_their_own():
    assert spans([at(0), at(1, area=Area.INPUT)]) == [Span(Area.HOLDING, 0, 1), Span(Area.INPUT, 1, 1)]


def test_a_request_is_no_longer_than_the_protocol_or_the_device_allows_and_parts_no_value():
    points = [at(address, 2) for address in range(0, 200, 2)]
    assert spans(points) == [Span(Area.HOLDING, 0, 124), Span(Area.HOLDING, 124, 76)]
    assert spans(points[:5], {3: 5}) == [
        Span(Area.HOLDING, 0, 4),
        Span(Area.HOLDING, 4, 4),
        Span(Area.HOLDING, 8, 2),
    ]


def test_points_that_overlap_are_read_once():
    assert spans([at(0, 4), at(1), at(3, 2)]) == [Span(Area.HOLDING, 0, 5)]


@given(st.lists(st.builds(at, st.integers(0, 300), st.integers(1, 4), st.sampled_from(Area)), max_size=40))
def test_every_point_is_read_and_nothing_else(points):
    found = batches(points, NO_RULES, Holes())
    assert sorted(map(id, points)) == sorted(id(point) for batch in found for point in batch.points)
    wanted = {(p.area, address) for p in points for address in range(p.address, p.span.end)}
    read = [(b.span.area, address) for b in found for address in range(b.span.start, b.span.end)]
    assert set(read) == wanted
    for batch in found:
        assert all(batch.span.start <= p.address and p.span.end <= batch.span.end for p in batch.points)


def test_each_point_gets_its_own_part_of_a_response():
    (batch,) = batches([at(10), at(11, 2), at(12)], NO_RULES, Holes())
    assert [items.hex() for _, items in batch.items_read(bytes.fromhex("03 06 000A 000B 000C"))] == [
        "000a",
        "000b000c",
        "000c",
    ]
    (batch,) = batches([at(address, area=Area.COILS) for address in (5, 6, 7)], NO_RULES, Holes())
    assert [items for _, items in batch.items_read(b"\1\1\5")] == [b"\1", b"\0", b"\1"]


def test_a_response_that_is_too_short_has_no_values():
    (batch,) = batches([at(10), at(11)], NO_RULES, Holes())
    with pytest.raises(ValueError, match="2 bytes"):
        [*batch.items_read(b"\3\2\0\1")]


def bridging(max_gap, areas=None, limits=None):
    return ReadRules(limits or {}, max_gap, areas or {})


def reads(points, rules, holes=None):
    return [f"{batch.span.area} {batch.span.addresses}" for batch in batches(points, rules, holes or Holes())]


def test_a_read_bridges_as_many_addresses_as_the_profile_allows_and_no_more():
    points = [at(0, 2), at(4, 2), at(9, 2)]
    assert reads(points, bridging(1)) == ["holding 0-1", "holding 4-5", "holding 9-10"]
    assert reads(points, bridging(2)) == ["holding 0-5", "holding 9-10"]
    assert reads(points, bridging(3)) == ["holding 0-10"]
    (batch,) = batches(points, bridging(3), Holes())
    assert batch.request == bytes.fromhex("03 0000 000B")
    coils = [at(address, area=Area.COILS) for address in (0, 7, 16)]
    assert reads(coils, bridging(8)) == ["coils 0-16"]


def test_a_read_bridges_only_addresses_that_exist():
    points, areas = [at(0, 2), at(4, 2), at(9, 2)], {Area.HOLDING: ((0, 6), (8, 20))}
    assert reads(points, bridging(9, areas)) == ["holding 0-5", "holding 9-10"]


def test_a_read_bridges_no_address_that_is_only_written():
    points = [at(0, 2), at(4, 2), at(9, 2)]
    rules = replace(bridging(9), only_written=(Span(Area.HOLDING, 3, 1), Span(Area.INPUT, 7, 1)))
    assert reads(points, rules) == ["holding 0-1", "holding 4-10"]


def test_a_bridging_read_is_no_longer_than_the_device_allows():
    assert reads([at(0, 2), at(4, 2), at(8, 2)], bridging(9, limits={3: 6})) == ["holding 0-5", "holding 8-9"]


def test_registers_of_different_widths_are_read_apart():
    points = [at(0), Point("wide", Area.HOLDING, 1, "float32", width=4), Point("w", Area.HOLDING, 3, width=4), at(2)]
    assert reads(points, bridging(9)) == ["holding 0-2", "holding 1-3"]


def test_a_point_and_its_scale_are_in_one_read_with_what_lies_between():
    energy = Point("energy", Area.HOLDING, 10, "uint32", count=2, scale_at=16)
    assert reads([energy, at(13), at(17)], NO_RULES) == ["holding 10-17"]
    (batch,) = batches([energy, at(13)], NO_RULES, Holes())
    assert (batch.hole, batch.bridged) == (None, 0)
    assert [batch.span.addresses for batch in batch.parts] == ["10-16", "13"]


def test_what_a_device_has_refused_is_not_bridged_again():
    points, holes = [at(0), at(3), at(6), at(9)], Holes()
    (batch,) = batches(points, bridging(2), holes)
    assert (batch.bridged, batch.hole) == (6, Span(Area.HOLDING, 4, 2))
    holes.add(batch.hole)
    assert reads(points, bridging(2), holes) == ["holding 0-3", "holding 6-9"]
    assert [f"{part.span.addresses}" for part in batch.parts] == ["0-3", "6-9"]
    assert reads([at(0), at(3), at(9)], bridging(9), holes) == ["holding 0-3", "holding 9"], "more than was refused"
    assert reads([at(4), at(6)], bridging(9), holes) == ["holding 4-6"], "a part of it may be answered"


def test_a_refused_read_without_holes_is_read_point_by_point():
    (batch,) = batches([at(0), at(1, 2), at(3)], bridging(9), Holes())
    assert [part.span.addresses for part in batch.parts] == ["0", "1-2", "3"]
    assert [part.parts for part in batch.parts] == [(), (), ()]


POINTS = st.lists(st.builds(at, st.integers(0, 200), st.integers(1, 4), st.sampled_from(Area)), max_size=40)
RANGES = st.lists(st.integers(0, 203), min_size=2, max_size=8, unique=True).map(sorted)
RULES = st.builds(
    lambda gap, edges, most: bridging(gap, {Area.HOLDING: (*zip(edges[::2], edges[1::2], strict=False),)}, {3: most}),
    st.integers(0, 12),
    RANGES,
    st.integers(4, 60),
)


def exists(rules, area, address):
    ranges = rules.areas.get(area)
    return ranges is None or any(first <= address <= last for first, last in ranges)


@given(POINTS, RULES)
def test_bridging_reads_have_every_point_once_and_no_hole_that_is_not_allowed(points, rules):
    found = batches(points, rules, Holes())
    assert sorted(map(id, points)) == sorted(id(point) for batch in found for point in batch.points)
    for batch in found:
        area, read = batch.span.area, range(batch.span.start, batch.span.end)
        assert len(read) <= rules.most(area)
        own = {address for point in batch.points for address in range(point.address, point.span.end)}
        assert own <= set(read)
        assert all(exists(rules, area, address) for address in set(read) - own)
        gaps = "".join(" " if address in own else "x" for address in read).split()
        assert max(map(len, gaps), default=0) <= rules.max_gap
        assert batch.bridged == sum(map(len, gaps))


@given(POINTS, RULES)
def test_there_are_as_few_bridging_reads_as_points_in_their_order_allow(points, rules):
    def fewest(ordered):
        """Try every way to cut a list of points into reads."""
        best = [0]
        for end in range(1, len(ordered) + 1):
            starts = (s for s in range(end) if len(batches(ordered[s:end], rules, Holes())) == 1)
            best.append(1 + min(best[start] for start in starts))
        return best[-1]

    points = sorted(points, key=lambda point: (point.area, point.address))[:12]
    assert len(batches(points, rules, Holes())) == fewest(points)


@given(POINTS, RULES)
def test_the_parts_of_a_refused_read_have_its_points_and_end_with_single_ones(points, rules):
    found = batches(points, rules, Holes())
    while found:
        batch = found.pop()
        parts = batch.parts
        assert parts or len(batch.points) == 1
        if parts:
            assert [id(point) for part in parts for point in part.points] == [id(point) for point in batch.points]
            if batch.hole is not None:
                assert len(parts) == 2
                assert parts[0].span.end == batch.hole.start
                assert parts[1].span.start == batch.hole.end
            found += parts
