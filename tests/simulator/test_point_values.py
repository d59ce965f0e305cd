"""Values that a point can carry, and how a device encodes them."""

import pytest

from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.simulator.point_values import Texts, choice, course, encoded, exponent_of, put, typed, without_value

TEXTS = Texts("Maker", "Meter")


def point(**keys) -> Point:
    return Point("voltage", Area.HOLDING, 0, **{"unit": "V", **keys})


def value(of: Point, wanted: float, exponent: int = 0) -> object:
    return of.value(encoded(of, wanted, exponent, bytes(2 * of.count)))


@pytest.mark.parametrize(
    ("keys", "wanted", "found"),
    [
        ({}, 230.4, 230),
        ({"scale": 0.1}, 230.44, 230.4),
        ({"scale": 0.1, "offset": -40}, 230.44, 230.4),
        ({"invalid": (230,)}, 230, 231),
        ({"invalid": (230,), "maximum": 230}, 230, 229),
        ({"labels": {230: "usual", 231: "high"}}, 230, 232),
        ({"maximum": 200}, 230, 200),
        ({"minimum": 300}, 230, 300),
        ({"scale": -0.1, "type": "int16", "minimum": 10, "maximum": 200}, 230, 200),
        ({"scale": -0.1, "type": "int16", "minimum": 10, "maximum": 200}, -230, 10),
        ({"type": "int16"}, 1e9, 32767),
        ({"type": "bcd16"}, 1e9, 9999),
        ({"type": "float32", "count": 2}, 230.123456789, 230.1235),
        ({"type": "float32", "count": 2, "maximum": 200}, 230, 200),
    ],
)
def test_the_nearest_value_that_fits(keys, wanted, found):
    assert value(point(**keys), wanted) == found


def test_where_every_number_means_something_else_one_of_them_is_taken():
    assert value(point(minimum=1, maximum=2, labels={1: "one", 2: "two"}), 1) == "one"


@pytest.mark.parametrize(
    ("data_type", "unit", "exponent"), [("uint16", "V", -2), ("int16", "mV", 2), ("uint32", "V", -3)]
)
def test_the_finest_power_of_ten_with_which_all_fit(data_type, unit, exponent):
    of = point(type=data_type, unit=unit, scale_at=9)
    assert exponent_of([of], "seed") == exponent
    assert exponent_of([of, point(unit="mV", type="int16", scale_at=9)], "seed") == 2


def test_where_none_is_enough_it_is_the_largest():
    assert exponent_of([point(scale=1e-20, scale_at=9)], "seed") == 10


def test_a_course_stays_where_the_encoding_ends():
    way = course(point(scale=0.001), 0, "seed", steady=False)
    assert 0 < way.middle < 65.5
    assert way.moves
    assert not course(point(), 0, "seed", steady=True).moves


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"labels": {3: "closed", 0: "open"}}, "closed"),
        ({"labels": {0: "Off", 4: "MPPT", 5: "on"}}, "MPPT"),
        ({"labels": {0: "off", 1: "on"}, "invalid": (0,)}, "on"),
        ({"labels": {0: "off", 1: "on"}, "minimum": 1}, "on"),
        ({"labels": {0: "off"}, "invalid": (0,)}, None),
        ({"type": "string", "count": 2}, "Mete"),
        ({"type": "string", "count": 3, "bits": (0, 7)}, "Met"),
        ({}, None),
    ],
)
def test_what_has_no_number(keys, text):
    assert choice(point(**keys), TEXTS, "seed") == text


def test_a_bit_is_0_or_1_and_an_alarm_is_off():
    bits = [Point(f"relay-{number}", Area.COILS, number, "bit") for number in range(32)]
    assert {choice(each, TEXTS, "seed") for each in bits} == {"0", "1"}
    alarms = [Point(f"alarm-{number}", Area.HOLDING, 0, bits=(number, number)) for number in range(16)]
    assert {choice(each, TEXTS, "seed") for each in alarms} == {"0"}


@pytest.mark.parametrize(
    ("keys", "items"),
    [
        ({"type": "int16", "invalid": (-32768,)}, "8000"),
        ({"type": "float32", "count": 2}, "7FC00000"),
        ({"type": "float32", "count": 2, "invalid": (-1,)}, "BF800000"),
        ({"type": "bcd32", "count": 2}, "FFFFFFFF"),
        ({"type": "int8", "bits": (8, 15), "invalid": (-128,)}, "8000"),
        ({"bits": (3, 3), "invalid": (0xFFFF,)}, "FFFF"),
        ({"type": "uint32", "count": 2, "swap": "words", "invalid": (0x80000000,)}, "00008000"),
    ],
)
def test_no_value(keys, items):
    of = point(**keys)
    assert without_value(of) == bytes.fromhex(items)
    assert of.value(without_value(of)) is None


def test_bits_and_characters_leave_the_others_as_they_are():
    bits = point(bits=(4, 6))
    assert put(bits, typed(bits, "5", b""), b"\xff\xff") == b"\xff\xdf"
    text = point(type="string", count=2, bits=(8, 15))
    assert put(text, typed(text, "AB", b""), b"\1\2\3\4") == b"A\2B\4"
