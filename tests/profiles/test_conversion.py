"""Conversions between the encodings of two points: against exact fractions, for every pair of types."""

from fractions import Fraction
from math import isfinite
from struct import pack, unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.profiles.coding import arranged
from gateway.profiles.conversion import Conversion
from gateway.profiles.point import Point
from gateway.registers.datatypes import SWAPS, bounds, decode, encode, is_float, registers_of

WHOLE = ("uint16", "int16", "uint32", "int32", "uint64", "int64", "bcd16", "bcd32")
TYPES = (*WHOLE, "float32", "float64")
SCALES = (1.0, 0.1, 0.001, 10.0, 0.25, 3.0, -0.5, 1e-9)
OFFSETS = (0.0, 5.0, -0.3, 273.15)


def point(data_type: str, swap: str = "none", scale: float = 1.0, offset: float = 0.0, **keys) -> Point:
    count = keys.pop("count", registers_of(data_type))
    return Point("p", Area.HOLDING, 0, data_type, swap, count, scale=scale, offset=offset, **keys)


points = st.builds(
    point, st.sampled_from(TYPES), st.sampled_from(SWAPS), st.sampled_from(SCALES), st.sampled_from(OFFSETS)
)


@st.composite
def held(draw):
    """A point, and a number that its registers hold."""
    each = draw(points)
    if is_float(each.type):
        width = 32 if each.type == "float32" else 64
        number = draw(st.floats(allow_nan=False, allow_infinity=False, width=width))
        number = decode(encode(number, each.type), each.type)
    else:
        number = draw(st.integers(*bounds(each.type)))
    return each, number


def exact(number: float) -> Fraction:
    return Fraction(repr(number))


def expected(source: Point, number: float, target: Point) -> Fraction:
    value = exact(number) * exact(source.scale) + exact(source.offset)
    return (value - exact(target.offset)) / exact(target.scale)


def rounded(number: Fraction) -> int:
    """Round halves away from zero."""
    whole, rest = divmod(abs(number), 1)
    whole += rest >= Fraction(1, 2)
    return int(whole) if number >= 0 else -int(whole)


@given(held(), points)
def test_a_value_is_the_same_in_every_encoding(source_and_number, target):
    source, number = source_and_number
    found = Conversion(source, target)(encode(number, source.type, source.swap))
    wanted = expected(source, number, target)
    if is_float(target.type):
        try:
            near = float(wanted)
            pack(">f" if target.type == "float32" else ">d", near)
        except OverflowError:
            assert found is None
            return
        assert found is not None
        layout = ">f" if target.type == "float32" else ">d"
        got = unpack(layout, _plain(found, target.swap))[0]
        assert got == unpack(layout, pack(layout, near))[0]
        return
    least, greatest = bounds(target.type)
    number = rounded(wanted)
    assert found == (encode(number, target.type, target.swap) if least <= number <= greatest else None)


@given(held(), st.sampled_from(SWAPS))
def test_the_same_type_is_rearranged_only(source_and_number, swap):
    source, number = source_and_number
    target = point(source.type, swap, source.scale, source.offset)
    assert Conversion(source, target)(encode(number, source.type, source.swap)) == encode(number, source.type, swap)


@given(held(), points)
def test_there_and_back(source_and_number, target):
    """A wider target without a rounding scale gives back the same registers."""
    source, number = source_and_number
    wide = point("float64" if is_float(source.type) else "int64", target.swap)
    if (source.scale, source.offset) != (1.0, 0.0):
        wide = point(source.type, target.swap, source.scale, source.offset)
    items = encode(number, source.type, source.swap)
    there = Conversion(source, wide)(items)
    if there is not None:  # a uint64 may be too large
        back = Conversion(wide, source)(there)
        assert back == items or (number == 0 and is_float(source.type))


@given(st.binary(min_size=4, max_size=4), st.sampled_from(SWAPS), st.sampled_from(SWAPS))
def test_a_float32_keeps_its_bits(data, one, other):
    found = Conversion(point("float32", one), point("float32", other))(_plain(data, one))
    assert found == (_plain(data, other) if isfinite(unpack(">f", data)[0]) else None)


def _plain(data: bytes, swap: str) -> bytes:
    return arranged(swap, len(data))(data)


@pytest.mark.parametrize("number", [2**63 - 1, -(2**63), 2**53 + 1, 9_007_199_254_740_993])
def test_numbers_of_64_bits_are_exact(number):
    milli = Conversion(point("int64", "words", 0.001), point("int64", "none", 0.001, 0.002))
    if number > 0:
        assert milli(encode(number, "int64", "words")) == encode(number - 2, "int64")
    tenths = Conversion(point("int64", scale=10.0), point("int64", scale=1.0))
    assert tenths(encode(number // 100, "int64")) == encode(number // 100 * 10, "int64")


@pytest.mark.parametrize(
    ("source", "items", "target", "found"),
    [
        (point("int16", scale=0.1), "0005", point("int16"), "0001"),  # halves away from zero
        (point("int16", scale=0.1), "FFFB", point("int16"), "FFFF"),
        (point("int16", scale=0.1), "0004", point("int16"), "0000"),
        (point("int16", scale=0.1), "FFFC", point("int16"), "0000"),
        (point("float32"), "3D4CCCCD", point("uint16", scale=0.1), "0001"),  # 0.05, which is more in binary
        (point("float64"), "3FA999999999999A", point("uint16", scale=0.1), "0001"),
        (point("float32"), "3DCCCCCD", point("float64"), "3FB999999999999A"),  # 0.1
        (point("bcd16"), "1234", point("uint16"), "04D2"),
        (point("bcd16"), "12A4", point("uint16"), None),
        (point("uint16"), "270F", point("bcd16"), "9999"),
        (point("uint16"), "2710", point("bcd16"), None),
        (point("float64"), "7FEFFFFFFFFFFFFF", point("float32"), None),
        (point("float32"), "7FC00000", point("uint16"), None),
        (point("float32"), "FF800000", point("float64"), None),
        (point("float32", invalid=(-1.0,)), "BF800000", point("float32", "words"), None),
        (point("uint16", invalid=(65535,)), "FFFF", point("uint32"), None),
        (point("uint16", invalid=(65535,)), "FFFF", None, None),
        (point("uint16", invalid=(65535,)), "FFFE", None, "FFFE"),
        (point("float32", "words"), "0000 7FC0", None, None),
        (point("float32", "words"), "0000 3F80", None, "0000 3F80"),
        (point("uint32"), "0000FFFF", point("uint16", invalid=(65535,)), None),
        (point("uint16", bits=(4, 7)), "12A4", point("uint16"), "000A"),
        (point("uint16", bits=(4, 7)), "12A4", None, "12A4"),
        (point("int8", bits=(0, 7)), "12FE", point("int16"), "FFFE"),
        (point("int16"), "FFFE", point("int8", bits=(8, 15)), "FE00"),
        (point("uint16"), "0010", point("uint16", bits=(4, 7)), None),
        (point("uint16", labels={5: "five"}), "0005", point("uint32"), "00000005"),
        (point("uint16", decimals=1, scale=0.001), "0001", point("float64"), "3F50624DD2F1A9FC"),
        (point("uint32", width=4, count=1), "00010002", point("uint32", "words"), "0002 0001"),
        (point("string", count=2), "41420000", point("string", "bytes", count=3), "4241 0000 0000"),
        (point("string", count=2), "41424344", point("string", count=1), None),
        (point("string", count=1), "4142", point("uint16"), None),
        (point("uint16"), "4142", point("string"), None),
        (point("string", count=2), "4142FF00", point("string", "bytes", count=2), "4241 00FF"),
        (point("int16", scale_at=1), "0005 0002", point("int16"), "01F4"),
        (point("int16", scale_at=1), "0005 FFFF", point("int16"), "0001"),
        (point("int16", scale_at=1), "0005 8000", point("int16"), None),
        (point("int16", scale_at=1), "0005 8000", None, None),
        (point("int16", scale_at=1), "0005 0002", None, "0005"),
        (point("uint16"), "0005", point("uint16", scale_at=1), None),
    ],
)
def test_a_conversion(source, items, target, found):
    result = Conversion(source, target)(bytes.fromhex(items))
    assert result == (None if found is None else bytes.fromhex(found))


def test_bits():
    coil, register = Point("c", Area.COILS, 0, "bit"), point("uint16")
    bit = point("uint16", bits=(3, 3))
    assert Conversion(coil, register)(b"\1") == b"\0\1"
    assert Conversion(register, coil)(b"\0\1") == b"\1"
    assert Conversion(register, coil)(b"\0\2") is None
    assert Conversion(bit, coil)(b"\0\x08") == b"\1"
    assert Conversion(coil, bit)(b"\1") == b"\0\x08"
    assert Conversion(coil, None)(b"\1") == b"\1"


def test_a_scale_register_of_the_target():
    there = Conversion(point("int32"), point("int16", scale_at=1))
    assert there(encode(500, "int32"), bytes.fromhex("0000 0002")) == b"\0\5"
    assert there(encode(500, "int32"), bytes.fromhex("0000 8000")) is None
    assert there(encode(500, "int32")) is None


def test_whether_there_is_a_value():
    there = Conversion(point("int16", invalid=(-1,)), point("uint16"))
    assert there.has_value(b"\xff\xfe")
    assert not there.has_value(b"\xff\xff")
