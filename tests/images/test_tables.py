"""The four tables: which items exist, what they hold, in which form they travel."""

import pytest

from gateway.images.tables import BitTable, RegisterTable, make_tables
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span


def test_items_are_zero_at_first():
    tables = make_tables(dict.fromkeys(Area, ((0, 3),)), {})
    assert {area: table.values(0, 4) for area, table in tables.items()} == dict.fromkeys(Area, (0, 0, 0, 0))


def test_an_area_that_is_not_named_has_no_items():
    tables = make_tables({}, {})
    assert list(tables) == list(Area)
    assert not any(table.has(Span(area, 0, 1)) for area, table in tables.items())


def test_initial_values_stand_at_their_addresses():
    ranges = {Area.HOLDING: ((0, 9),), Area.COILS: ((5, 6),)}
    tables = make_tables(ranges, {Area.HOLDING: [(1, (7, 65535)), (9, (8,))], Area.COILS: [(5, (1, 1))]})
    assert tables[Area.HOLDING].values(0, 10) == (0, 7, 65535, 0, 0, 0, 0, 0, 0, 8)
    assert tables[Area.COILS].values(5, 2) == (1, 1)


def test_a_later_initial_value_replaces_an_earlier_one():
    tables = make_tables({Area.INPUT: ((0, 1),)}, {Area.INPUT: [(0, (1, 2)), (1, (3,))]})
    assert tables[Area.INPUT].values(0, 2) == (1, 3)


@pytest.mark.parametrize("area", Area)
def test_a_table_reaches_from_the_first_address_to_the_last(area):
    table = make_tables({area: ((0, 65535),)}, {})[area]
    table.assign(0, [1])
    table.assign(65535, [1])
    assert table.values(0, 65536) == (1, *[0] * 65534, 1)


@pytest.mark.parametrize("bad", [(-1, 5), (5, 4), (0, 65536)])
def test_a_range_must_lie_within_the_addresses(bad):
    with pytest.raises(ValueError, match="is no range of addresses"):
        RegisterTable(Area.HOLDING, (bad,))


@pytest.mark.parametrize(
    ("area", "start", "values", "complaint"),
    [
        (Area.HOLDING, 9, (1, 2), "holding 9-10 do not all exist"),
        (Area.HOLDING, 15, (1,), "holding 15-15 do not all exist"),
        (Area.INPUT, 0, (1,), "input 0-0 do not all exist"),
        (Area.HOLDING, 0, (0, 65536), "holding from 0 on: values must be 0 to 65535"),
        (Area.HOLDING, 0, (-1,), "holding from 0 on: values must be 0 to 65535"),
        (Area.COILS, 0, (1, 2), "coils from 0 on: values must be 0 to 1"),
    ],
)
def test_an_initial_value_must_have_an_item_and_fit(area, start, values, complaint):
    ranges = {Area.HOLDING: ((0, 9), (20, 29)), Area.COILS: ((0, 9),)}
    with pytest.raises(ValueError, match=complaint):
        make_tables(ranges, {area: [(start, values)]})


def test_nothing_is_assigned_when_one_number_does_not_fit():
    table = RegisterTable(Area.HOLDING, ((0, 2),))
    with pytest.raises(ValueError, match="values must be"):
        table.assign(0, [1, 2, 65536])
    assert table.values(0, 3) == (0, 0, 0)


def test_values_of_items_that_do_not_exist_cannot_be_had():
    table = RegisterTable(Area.HOLDING, ((0, 2), (5, 7)))
    with pytest.raises(ValueError, match="holding 2-5 do not all exist"):
        table.values(2, 4)


@pytest.mark.parametrize(
    ("start", "count", "exists"),
    [(1, 1, True), (1, 99, True), (99, 1, True), (0, 1, False), (99, 2, False), (98, 5, False), (200, 2, True)],
)
def test_only_spans_within_one_range_exist(start, count, exists):
    table = RegisterTable(Area.HOLDING, ((1, 99), (200, 201)))
    assert table.has(Span(Area.HOLDING, start, count)) is exists


def test_bits_travel_eight_a_byte_the_first_one_lowest():
    table = BitTable(Area.COILS, ((0, 15),))
    table.write(Span(Area.COILS, 2, 10), bytes.fromhex("CD 01"))
    assert table.values(0, 16) == (0, 0, 1, 0, 1, 1, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0)
    assert table.read(Span(Area.COILS, 2, 10)) == bytes.fromhex("CD 01")


def test_bits_behind_the_last_coil_are_ignored():
    table = BitTable(Area.COILS, ((0, 15),))
    table.write(Span(Area.COILS, 0, 9), bytes.fromhex("FF FF"))
    assert table.values(0, 16) == (*[1] * 9, *[0] * 7)


def test_registers_travel_with_the_high_byte_first():
    table = RegisterTable(Area.HOLDING, ((0, 3),))
    table.write(Span(Area.HOLDING, 1, 2), bytes.fromhex("12 34 AB CD"))
    assert table.values(0, 4) == (0, 0x1234, 0xABCD, 0)
    assert table.read(Span(Area.HOLDING, 1, 2)) == bytes.fromhex("12 34 AB CD")
