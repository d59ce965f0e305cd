"""Which requests read a number of points."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.batches import batches
from gateway.profiles.point import Point


def at(address, count=1, area=Area.HOLDING):
    return Point(f"{area}-{address}", area, address, count=count)


def spans(points, limits=None):
    return [batch.span for batch in batches(points, limits or {})]


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
    found = batches(points, {})
    assert sorted(map(id, points)) == sorted(id(point) for batch in found for point in batch.points)
    wanted = {(p.area, address) for p in points for address in range(p.address, p.span.end)}
    read = [(b.span.area, address) for b in found for address in range(b.span.start, b.span.end)]
    assert set(read) == wanted
    for batch in found:
        assert all(batch.span.start <= p.address and p.span.end <= batch.span.end for p in batch.points)


def test_each_point_gets_its_own_part_of_a_response():
    (batch,) = batches([at(10), at(11, 2), at(12)], {})
    assert [items.hex() for _, items in batch.items_read(bytes.fromhex("03 06 000A 000B 000C"))] == [
        "000a",
        "000b000c",
        "000c",
    ]
    (batch,) = batches([at(address, area=Area.COILS) for address in (5, 6, 7)], {})
    assert [items for _, items in batch.items_read(b"\1\1\5")] == [b"\1", b"\0", b"\1"]


def test_a_response_that_is_too_short_has_no_values():
    (batch,) = batches([at(10), at(11)], {})
    with pytest.raises(ValueError, match="2 bytes"):
        [*batch.items_read(b"\3\2\0\1")]
