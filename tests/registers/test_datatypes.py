"""How registers carry values."""

import math
from struct import pack, unpack

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.registers.datatypes import DATA_TYPES, SWAPS, bounds, decode, encode, is_whole, registers_of, swapped

NUMBERS = [each for each in DATA_TYPES if each not in ("bit", "string")]
WHOLE = [each for each in NUMBERS if is_whole(each)]
swaps = st.sampled_from(SWAPS)


@pytest.mark.parametrize(
    ("data_type", "swap", "data", "value"),
    [
        ("uint16", "none", "FFFE", 65534),
        ("uint16", "bytes", "FEFF", 65534),
        ("int16", "none", "FFFE", -2),
        ("uint32", "none", "11223344", 0x11223344),
        ("uint32", "words", "33441122", 0x11223344),
        ("uint32", "bytes", "22114433", 0x11223344),
        ("uint32", "both", "44332211", 0x11223344),
        ("uint64", "words", "7788556633441122", 0x1122334455667788),
        ("int32", "none", "FFFFFFFF", -1),
        ("int64", "both", "FEFFFFFFFFFFFFFF", -2),
        ("float32", "none", "46160000", 9600.0),
        ("float32", "none", "459C3D51", 4999.6646),
        ("float32", "words", "00004616", 9600.0),
        ("float64", "none", "400921FB54442D18", math.pi),
        ("string", "none", "4142430000", "ABC"),
        ("string", "bytes", "42410043", "ABC"),
        ("string", "none", "41422020", "AB"),
        ("string", "none", "FF41", "\ufffdA"),
    ],
)
def test_a_value_is_read_from_its_registers(data_type, swap, data, value):
    assert decode(bytes.fromhex(data), data_type, swap) == value


@given(st.sampled_from(WHOLE), swaps, st.data())
def test_whole_numbers_come_back_as_they_were(data_type, swap, data):
    number = data.draw(st.integers(*bounds(data_type)))
    carried = encode(number, data_type, swap)
    assert len(carried) == 2 * registers_of(data_type)
    assert decode(carried, data_type, swap) == number


@given(st.floats(), swaps)
def test_a_float64_comes_back_as_it_was(number, swap):
    back = decode(encode(number, "float64", swap), "float64", swap)
    assert back == number or (math.isnan(back) and math.isnan(number))


@given(st.binary(min_size=4, max_size=4))
@example(bytes.fromhex("7F7FFFFF"))
@example(bytes.fromhex("FF800000"))
def test_the_number_that_is_shown_for_a_float32_stands_for_it(data):
    """And no shorter one does; registers with not-a-number stay not-a-number."""
    number = decode(data, "float32")
    exact = unpack(">f", data)[0]
    if math.isnan(exact):
        assert math.isnan(number)
        return
    assert encode(number, "float32") == data
    assert len(f"{number:.9g}") <= len(f"{exact:.9g}")


@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=30), swaps)
def test_text_comes_back_without_spaces_at_its_end(text, swap):
    size = len(text.encode())
    carried = encode(text, "string", swap, length=(size + 1) // 2 + 1)
    assert decode(carried, "string", swap) == text.rstrip(" ")


@given(st.binary().map(lambda data: data[: len(data) // 2 * 2]), swaps)
def test_a_swap_done_twice_is_none(data, swap):
    assert swapped(swapped(data, swap), swap) == data


@pytest.mark.parametrize("data_type", WHOLE)
def test_a_number_that_does_not_fit_is_refused_with_the_bounds(data_type):
    least, greatest = bounds(data_type)
    for number in (least - 1, greatest + 1):
        with pytest.raises(
            ValueError, match=f"^{number} does not fit into {data_type}: .* from {least} to {greatest}$"
        ):
            encode(number, data_type)


@pytest.mark.parametrize("number", [1.5, math.nan, math.inf])
def test_what_is_no_whole_number_is_refused(number):
    with pytest.raises(ValueError, match="does not fit into uint16: whole numbers"):
        encode(number, "uint16")


def test_a_fraction_without_a_rest_is_a_whole_number():
    assert encode(7.0, "uint16") == pack(">H", 7)


def test_what_is_too_great_for_a_float32_is_refused():
    with pytest.raises(ValueError, match=r"^1e\+39 does not fit into float32$"):
        encode(1e39, "float32")


@pytest.mark.parametrize(
    ("text", "length", "reason"),
    [
        ("ABCDE", 2, '"ABCDE" has 5 bytes, and 2 registers hold 4'),
        ("é" * 3, 2, "has 6 bytes"),
        ("A\0B", 2, "cannot have a NUL"),
        ("A\ud800", 2, r"cannot have U\+D800 in it"),
    ],
)
def test_text_that_does_not_fit_is_refused(text, length, reason):
    with pytest.raises(ValueError, match=reason):
        encode(text, "string", length=length)


def test_text_is_no_number():
    with pytest.raises(ValueError, match='"AB" is text, and uint16 is a number'):
        encode("AB", "uint16")
