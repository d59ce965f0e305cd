"""Items: their reference numbers, the requests that read and write them, and the responses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span, parse_request
from gateway.registers.items import (
    WRITERS,
    has_bits,
    items_read,
    most_written,
    pack_bits,
    place_of,
    read_request,
    reference,
    unpack_bits,
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
    ("area", "start", "items", "how", "request_pdu"),
    [
        (Area.COILS, 0xAC, "01", "auto", "05 00 AC FF 00"),
        (Area.COILS, 0xAC, "00", "auto", "05 00 AC 00 00"),
        (Area.COILS, 0xAC, "01", "multiple", "0F 00 AC 00 01 01 01"),
        (Area.COILS, 0x13, "01 00 01 01 00 00 01 01 00 00", "auto", "0F 00 13 00 0A 02 CD 00"),
        (Area.HOLDING, 0x87, "03 9E", "auto", "06 00 87 03 9E"),
        (Area.HOLDING, 0x100, "00 05", "multiple", "10 01 00 00 01 02 00 05"),
        (Area.HOLDING, 0x87, "03 9E", "single", "06 00 87 03 9E"),
        (Area.HOLDING, 0x87, "00 0A 01 02", "auto", "10 00 87 00 02 04 00 0A 01 02"),
    ],
)
def test_items_are_written_as_the_documents_print_it(area, start, items, how, request_pdu):
    assert write_request(area, start, bytes.fromhex(items), how=how) == bytes.fromhex(request_pdu)


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


def test_bits_are_packed_lowest_first_and_padded_with_zeros():
    """Coils 20-38 of A 6.1: CD 6B 05."""
    bits = bytes(int(bit) for bit in "1011001111010110101")
    assert pack_bits(bits) == bytes.fromhex("CD 6B 05")
    assert unpack_bits(bytes.fromhex("CD 6B 05"), 19) == bits


def test_no_bits_are_no_bytes():
    assert pack_bits(b"") == unpack_bits(b"", 0) == b""


@given(st.lists(st.integers(0, 1), max_size=2000).map(bytes))
def test_unpacking_is_the_opposite_of_packing(bits):
    packed = pack_bits(bits)
    assert len(packed) == (len(bits) + 7) // 8
    assert unpack_bits(packed, len(bits)) == bits


@given(st.binary(max_size=250))
def test_packing_is_the_opposite_of_unpacking(data):
    assert pack_bits(unpack_bits(data, 8 * len(data))) == data


@pytest.mark.parametrize(
    ("area", "address", "number"),
    [
        (Area.HOLDING, 0, "40001"),
        (Area.HOLDING, 107, "40108"),
        (Area.HOLDING, 9998, "49999"),
        (Area.HOLDING, 9999, "410000"),
        (Area.HOLDING, 65535, "465536"),
        (Area.COILS, 126, "00127"),
        (Area.COILS, 9999, "010000"),
        (Area.DISCRETE, 0, "10001"),
        (Area.INPUT, 0, "30001"),
    ],
)
def test_a_reference_counts_from_1_behind_the_digit_of_its_area(area, address, number):
    assert reference(area, address) == number


@given(st.sampled_from(Area), st.integers(0, 65535))
def test_each_reference_leads_back(area, address):
    assert place_of(reference(area, address)) == (area, address)


def test_a_short_address_may_have_six_digits():
    assert place_of("400001") == (Area.HOLDING, 0)


@pytest.mark.parametrize("text", ["", "40000", "4001", "20001", "465537", "4000x", "4000001", "²0001"])
def test_other_numbers_are_none(text):
    assert place_of(text) is None


def test_wide_registers_are_written_with_function_16_and_four_bytes_each():
    """As Enron's registers from 5001 on; 61 of them fill a request."""
    pdu = write_request(Area.HOLDING, 5000, bytes.fromhex("00 01 11 70"), width=4)
    assert pdu == bytes.fromhex("10 13 88 00 01 04 00 01 11 70")
    assert write_request(Area.HOLDING, 5000, bytes(4), width=4, how="single")[0] == 16
    most = most_written(Area.HOLDING, {}, 4)
    assert (most, len(write_request(Area.HOLDING, 5000, bytes(4 * most), width=4))) == (61, 250)
    assert most_written(Area.HOLDING, {16: 20}, 4) == 20
