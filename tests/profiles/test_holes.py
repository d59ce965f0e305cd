"""What is remembered of addresses that a device refuses to read together with others."""

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import MOST_HOLES, Holes, Split


def hole(start, count=1, area=Area.HOLDING):
    return Span(area, start, count)


def test_a_hole_is_refused_if_it_contains_one_that_was():
    holes = Holes()
    holes.add(hole(10, 4))
    assert holes.refuse(hole(10, 4))
    assert holes.refuse(hole(8, 9))
    assert not holes.refuse(hole(11, 3))
    assert not holes.refuse(hole(8, 5))
    assert not holes.refuse(hole(10, 4, Area.INPUT))


def test_the_oldest_holes_are_forgotten_first():
    holes = Holes()
    for start in range(MOST_HOLES + 1):
        holes.add(hole(2 * start))
    assert len(holes.refused) == MOST_HOLES
    assert [holes.refuse(hole(start)) for start in (0, 2, 2 * MOST_HOLES)] == [False, True, True]


def test_a_hole_is_remembered_when_both_of_its_sides_were_read_in_full():
    holes = Holes()
    whole = Split(hole(20), holes)
    left = Split(hole(10), holes, whole)
    left.part_was_read()
    whole.part_was_read()
    assert holes.refused == (), "half of the left side may be what is refused"
    left.part_was_read()
    assert holes.refuse(hole(10))
    assert holes.refuse(hole(20))
