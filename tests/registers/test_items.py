"""Request PDUs that read and write items, and the items in the responses."""

import pytest

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span, parse_request
from gateway.registers.items import (
    WRITERS,
    has_bits,
    items_read,
    most_written,
    read_request,
    write_function,
    write_request,
)


@pytest.mark.parametrize(
    ("span", "request_pdu"),
    [
        (Span(Area.COILS, 0x13, 0x25), "01 00 13 00 25"),
        (Span(Area.DISCRETE, 0, 1), "02 00 00 00 01"),
        (Span(Area.HOLDING, 0x6B, 3), "03 00 6B 00 03"),
        (Span(Area.INPUT, 0xFFFF, 1), "04 FF FF 00 01"),
    ],
)
def test_a_span_is_read_with_the_function_of_its_area(span, request_pdu):
    assert read_request(span) == bytes.fromhex(request_pdu)
    assert parse_request(read_request(span)).read == span


@pytest.mark.parametrize("area", Area)
def test_the_most_items_are_those_of_the_specification(area):
    _, most = READERS[area]
    assert parse_request(read_request(Span(area, 0, most))).items == most
    with pytest.raises(Exception, match="quantity"):
        parse_request(read_request(Span(area, 0, most + 1)))


@pytest.mark.parametrize("area", WRITERS)
def test_the_most_items_to_write_are_those_of_the_specification(area):
    _, _, most = WRITERS[area]
    item = b"\1" if has_bits(area) else b"\0\1"
    assert parse_request(write_request(area, 0, item * most)).items == most


@pytest.mark.parametrize(
    ("area", "start", "items", "multiple", "request_pdu"),
    [
        (Area.COILS, 0xAC, "01", False, "05 00 AC FF 00"),
        (Area.COILS, 0xAC, "00", False, "05 00 AC 00 00"),
        (Area.COILS, 0xAC, "01", True, "0F 00 AC 00 01 01 01"),
        (Area.COILS, 0x13, "01 00 01 01 00 00 01 01 00 00", False, "0F 00 13 00 0A 02 CD 00"),
        (Area.HOLDING, 0x87, "03 9E", False, "06 00 87 03 9E"),
        (Area.HOLDING, 0x100, "00 05", True, "10 01 00 00 01 02 00 05"),
        (Area.HOLDING, 0x87, "00 0A 01 02", False, "10 00 87 00 02 04 00 0A 01 02"),
    ],
)
def test_items_are_written_as_the_documents_print_it(area, start, items, multiple, request_pdu):
    assert write_request(area, start, bytes.fromhex(items), multiple=multiple) == bytes.fromhex(request_pdu)


@pytest.mark.parametrize(
    ("functions", "function"),
    [(None, 6), ({3, 6, 16}, 6), ({3, 6}, 6), ({3, 16}, 16), ({3}, 6)],
)
def test_one_register_is_written_with_function_16_where_the_unit_knows_no_06(functions, function):
    assert write_function(Area.HOLDING, 1, functions) == function
    assert write_request(Area.HOLDING, 0, b"\0\1", functions)[0] == function


def test_a_unit_may_allow_fewer_items_than_the_protocol_and_not_more():
    assert [most_written(Area.HOLDING, limits) for limits in ({}, {16: 20}, {16: 500}, {3: 20})] == [123, 20, 123, 123]


def test_coils_in_a_response_become_one_byte_each():
    assert items_read(Span(Area.COILS, 0x13, 10), bytes.fromhex("01 02 CD 01")) == bytes.fromhex("01000101000001010100")


def test_registers_in_a_response_stay_as_they_are():
    assert items_read(Span(Area.HOLDING, 0, 2), bytes.fromhex("03 04 45 9C 3D 51")) == bytes.fromhex("459C3D51")


def test_a_response_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match="carries 2 bytes, and 4 were asked for"):
        items_read(Span(Area.HOLDING, 0, 2), bytes.fromhex("03 04 45 9C"))
