"""What the items of a point mean, and how values become items."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.registers.datatypes import DATA_TYPES, SWAPS, registers_of
from gateway.registers.numbers import parse_number

WEIGHT = Point("weight", Area.HOLDING, 0, "float32", count=2, decimals=2, unit="kg")
STATE = Point("state", Area.HOLDING, 8, labels={0: "off", 1: "running"}, write="yes")
SPEED = Point("speed", Area.HOLDING, 10, "int32", "words", count=2, scale=0.1, unit="rpm", write="yes")
COIL = Point("valve", Area.COILS, 3, "bit", write="yes")
NAME = Point("name", Area.HOLDING, 20, "string", count=4, write="yes")
DOOR = Point("door", Area.DISCRETE, 3, "bit", labels={1: "open", 0: "closed"})


@pytest.mark.parametrize(
    ("point", "items", "value", "shown"),
    [
        (WEIGHT, "45 9C 3D 51", 4999.66, "4999.66"),
        (STATE, "00 01", "running", "running"),
        (STATE, "00 05", 5, "5"),
        (SPEED, "FF FE FF FF", -0.2, "-0.2"),
        (SPEED, "00 0A 00 00", 1, "1"),
        (COIL, "01", 1, "1"),
        (DOOR, "01", "open", "open"),
        (NAME, "41 42 43 00 00 00 00 00", "ABC", "ABC"),
        (Point("a", Area.INPUT, 0, scale=0.1, decimals=1), "00 03", 0.3, "0.3"),
        (Point("a", Area.INPUT, 0, scale=0.1, decimals=1), "00 0A", 1.0, "1.0"),
        (Point("a", Area.INPUT, 0, scale=10), "00 0A", 100, "100"),
        (Point("a", Area.INPUT, 0, "float32", count=2, scale=2.0), "3F 80 00 00", 2.0, "2.0"),
        (Point("a", Area.INPUT, 0, "float32", count=2, scale=2.0, offset=-40.5), "3F 80 00 00", -38.5, "-38.5"),
        (Point("a", Area.INPUT, 0, "uint64", count=4, decimals=0), "FF " * 8, 2**64 - 1, "18446744073709551615"),
        (
            Point("a", Area.INPUT, 0, "int64", count=4, decimals=1),
            "80" + " 00" * 6 + " 01",
            1 - 2**63,
            f"{1 - 2**63}.0",
        ),
        (Point("a", Area.INPUT, 0, "float64", count=4, scale=10.0), "7F EF" + " FF" * 6, None, "–"),  # noqa: RUF001
        (Point("a", Area.INPUT, 0, "uint64", count=4, scale=1e300), "FF " * 8, None, "–"),  # noqa: RUF001
        (Point("a", Area.INPUT, 0, "uint64", count=4, scale=1.5e300), "FF " * 8, None, "–"),  # noqa: RUF001
    ],
)
def test_items_mean_a_value(point, items, value, shown):
    assert point.value(bytes.fromhex(items)) == value
    assert point.show(value) == shown


@pytest.mark.parametrize(
    ("point", "text", "items"),
    [
        (WEIGHT, "9600", "46 16 00 00"),
        (STATE, "running", "00 01"),
        (STATE, "0x10", "00 10"),
        (SPEED, "-0.2", "FF FE FF FF"),
        (SPEED, "1e2", "03 E8 00 00"),
        (COIL, "on", "01"),
        (COIL, "FALSE", "00"),
        (COIL, "1", "01"),
        (DOOR, "closed", "00"),
        (NAME, "ABC", "41 42 43 00 00 00 00 00"),
        (Point("a", Area.HOLDING, 0, "int16", scale=0.1, labels={-1: "none"}), "none", "FF FF"),
    ],
)
def test_what_is_written_becomes_items(point, text, items):
    assert point.items(text) == bytes.fromhex(items)


@pytest.mark.parametrize(
    ("point", "text", "reason"),
    [
        (STATE, "70000", r"^70000 does not fit into uint16: 0 to 65535$"),
        (STATE, "walking", r'^"walking" is not a number; it has the labels off, running$'),
        (STATE, "1.5", r"^1.5 does not fit into uint16: it holds whole numbers only$"),
        (STATE, "inf", r"^inf does not fit into uint16$"),
        (SPEED, "0.05", r"^0.05 is not a multiple of 0.1, the scale of speed$"),
        (SPEED, "1e9", r"^1e9 does not fit into int32: -214748364.8 to 214748364.7$"),
        (COIL, "2", r"^2 is not a bit: write 0 or 1, off or on$"),
        (COIL, "yes", r'^"yes" is not a bit: write 0 or 1, off or on$'),
        (Point("a", Area.HOLDING, 0, bits=(3, 3)), "yes", r'^"yes" is not a bit: write 0 or 1, off or on$'),
        (SPEED, "21,5", r'^"21,5" is not a number; decimals stand behind a point$'),
        (WEIGHT, "nan", r"^nan is not a finite number$"),
        (WEIGHT, "-inf", r"^-inf is not a finite number$"),
        (STATE, "1_000", r'^"1_000" is not a number'),
        (STATE, "\u0661\u0662", r"is not a number"),
        (WEIGHT, "1e39", r"^1e\+39 does not fit into float32$"),
        (WEIGHT, "1e400", r"^1e400 does not fit into float32$"),
        (WEIGHT, "1e999999999", r"^1e999999999 does not fit into float32$"),
        (STATE, "1e999999", r"^1e999999 does not fit into uint16$"),
        (STATE, "1e999999999", r"^1e999999999 does not fit into uint16$"),
        (STATE, "-1e-999999999", r"^-1e-999999999 does not fit into uint16$"),
        (SPEED, "1e999999999", r"^1e999999999 does not fit into int32$"),
        (COIL, "snan", r"^snan is not a bit: write 0 or 1, off or on$"),
        (COIL, "inf", r"^inf is not a bit: write 0 or 1, off or on$"),
        (NAME, "a long name", r'^"a long name" has 11 bytes, and 4 registers hold 8$'),
        (Point("a", Area.HOLDING, 0, scale=-1.0), "1", r"does not fit into uint16: -65535 to 0$"),
    ],
)
def test_what_a_point_cannot_hold_is_refused(point, text, reason):
    with pytest.raises(ValueError, match=reason):
        point.items(text)


@given(
    st.sampled_from([each for each in DATA_TYPES if each not in ("bit", "string", "uint64", "int64")]),
    st.sampled_from(SWAPS),
    st.sampled_from([1.0, 0.1, 0.001, 0.25, 10.0]),
    st.data(),
)
def test_a_value_that_was_read_can_be_written_again(data_type, swap, scale, data):
    """As it is shown. A scale on a float32 is the business of the device: half a digit may get lost there."""
    count = registers_of(data_type)
    if data_type.startswith("float"):
        scale = 1.0
    point = Point("a", Area.HOLDING, 0, data_type, swap, count, scale)
    items = data.draw(st.binary(min_size=2 * count, max_size=2 * count))
    value = point.value(items)
    if value is not None:
        assert point.items(point.show(value)) == items


@pytest.mark.parametrize("text", ["", "x", "0xG", "1,5", "--1", "0b2", "1_000", "0x1_0", "\u0661"])
def test_what_is_no_number_is_none(text):
    assert parse_number(text) is None


@pytest.mark.parametrize(("text", "number"), [("0x1F", 31), ("-0x1", -1), ("0b101", 5), ("+7", 7), ("1e3", 1000)])
def test_numbers_may_be_written_in_many_ways(text, number):
    assert parse_number(text) == number


FLOW = Point("flow", Area.INPUT, 12, "int16", scale=0.1, offset=-40.0, invalid=(-32768, 32767))
ALARMS = Point("alarm", Area.HOLDING, 8, bits=(3, 3), invalid=(0xFFFF,))
MODE = Point("mode", Area.HOLDING, 8, bits=(4, 6), labels={5: "auto"}, write="yes")
HIGH = Point("high", Area.HOLDING, 8, "int8", bits=(8, 15), invalid=(-128,))
CODE = Point("code", Area.HOLDING, 8, "bcd32", count=2, swap="words")
ENERGY = Point("energy", Area.INPUT, 30, "uint32", count=2, scale_at=33, invalid=(0xFFFFFFFF,))


@pytest.mark.parametrize(
    ("point", "items", "value"),
    [
        (FLOW, "00 0A", -39),
        (FLOW, "00 0B", -38.9),
        (FLOW, "80 00", None),
        (FLOW, "7F FF", None),
        (ALARMS, "00 08", 1),
        (ALARMS, "FF F7", 0),
        (ALARMS, "FF FF", None),
        (MODE, "00 5F", "auto"),
        (MODE, "FF BF", 3),
        (HIGH, "FE 00", -2),
        (HIGH, "80 00", None),
        (CODE, "56 78 12 34", 12345678),
        (CODE, "56 7A 12 34", None),
        (WEIGHT, "7F C0 00 00", None),
        (WEIGHT, "FF 80 00 00", None),
        (Point("t", Area.HOLDING, 1, "string", count=3, bits=(0, 7)), "11 41 22 42 33 00", "AB"),
        (Point("t", Area.HOLDING, 1, "string", count=3, bits=(8, 15)), "41 11 42 22 00 33", "AB"),
        (ENERGY, "00 01 00 00 AA AA FF FE", 655.36),
        (ENERGY, "00 00 00 07 AA AA 00 03", 7000),
        (ENERGY, "00 00 00 07 AA AA 80 00", None),
        (ENERGY, "FF FF FF FF AA AA 00 00", None),
    ],
)
def test_a_point_says_what_its_registers_mean(point, items, value):
    assert point.value(bytes.fromhex(items)) == value


def test_a_place_without_a_value_is_a_dash():
    assert (FLOW.show(None), WEIGHT.show(None)) == ("\u2013", "\u2013")


@pytest.mark.parametrize(
    ("point", "text", "items"),
    [
        (FLOW, "-38.9", "00 0B"),
        (MODE, "auto", "00 50"),
        (MODE, "7", "00 70"),
        (HIGH, "-2", "FE 00"),
        (CODE, "12345678", "56 78 12 34"),
        (ALARMS, "on", "00 08"),
        (Point("b", Area.HOLDING, 8, bits=(3, 3), swap="bytes"), "1", "08 00"),
    ],
)
def test_a_value_becomes_the_bits_of_its_point(point, text, items):
    assert point.items(text) == bytes.fromhex(items)


def test_a_value_with_a_scale_register_is_encoded_by_what_it_holds_now():
    assert ENERGY.items("655.36", bytes.fromhex("00 00 00 00 AA AA FF FE")) == bytes.fromhex("00 01 00 00")
    for before in (None, bytes.fromhex("00 00 00 00 AA AA 80 00")):
        with pytest.raises(ValueError, match=r"^the device has no scale for energy now$"):
            ENERGY.items("655.36", before)


@pytest.mark.parametrize(
    ("point", "text", "reason"),
    [
        (FLOW, "-38.95", r"^-38.95 is not -40 plus a multiple of 0.1, the offset and scale of flow$"),
        (MODE, "8", r"^8 does not fit into bits 4-6: 0 to 7$"),
        (ALARMS, "2", r"^2 does not fit into bit 3: 0 to 1$"),
        (HIGH, "200", r"^200 does not fit into int8: -128 to 127$"),
        (CODE, "-1", r"^-1 does not fit into bcd32: 0 to 99999999$"),
        (Point("p", Area.HOLDING, 1, minimum=5.0, maximum=9.5), "4", r"^4 is too low: p must be 5 to 9.5$"),
        (Point("p", Area.HOLDING, 1, minimum=5.0, maximum=9.5), "10", r"^10 is too high: p must be 5 to 9.5$"),
    ],
)
def test_a_value_that_the_point_must_not_have_is_refused(point, text, reason):
    with pytest.raises(ValueError, match=reason):
        point.items(text)


def test_its_scale_is_read_with_it():
    assert (ENERGY.span.addresses, ENERGY.read_span.addresses) == ("30-31", "30-33")
    before = Point("p", Area.INPUT, 30, "int16", scale_at=20)
    assert before.read_span.addresses == "20-30"
    assert before.value(bytes.fromhex("0001" + "0000" * 9 + "0005")) == 50


@pytest.mark.parametrize(
    ("point", "span"),
    [
        (FLOW, (Area.HOLDING, 12)),
        (Point("p", Area.INPUT, 1, write_at=9), (Area.HOLDING, 9)),
        (Point("p", Area.DISCRETE, 1, write_at=9), (Area.COILS, 9)),
        (COIL, (Area.COILS, COIL.address)),
    ],
)
def test_it_is_written_at_its_own_place_or_another(point, span):
    assert (point.write_span.area, point.write_span.start) == span
