"""The requests that write values at points."""

import pytest

from gateway.errors import DoesNotFit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.writing import Write, request_to_write, to_be_writable, writes_of, written

MASKING = frozenset({3, 6, 16, 22})


def point(name="p", area=Area.HOLDING, address=8, **more):
    return Point(name, area, address, **{"write": "yes", **more})


def request(*pairs, functions=None, limits=None, multiple=False) -> Write:
    """The request that writes these texts at these points."""
    readings = [written(each, text) for each, text in pairs]
    return request_to_write(readings, limits or {}, functions, multiple=multiple)


@pytest.mark.parametrize(
    ("at", "text", "functions", "pdu"),
    [
        (point(), "5", None, "06 00 08 00 05"),
        (point(), "5", {3, 16}, "10 00 08 00 01 02 00 05"),
        (point(write_function="multiple"), "5", None, "10 00 08 00 01 02 00 05"),
        (point(write_function="single"), "5", {3, 16}, "06 00 08 00 05"),
        (point(write_at=120), "5", None, "06 00 78 00 05"),
        (point(area=Area.INPUT, write_at=120), "5", None, "06 00 78 00 05"),
        (point(area=Area.DISCRETE, type="bit", write_at=3), "on", None, "05 00 03 FF 00"),
        (point(area=Area.COILS, type="bit", write_function="multiple"), "on", None, "0F 00 08 00 01 01 01"),
        (point(type="int32", count=2, write_at=120), "-2", None, "10 00 78 00 02 04 FF FF FF FE"),
        (point(type="bcd16"), "1234", None, "06 00 08 12 34"),
        (point(type="float32", width=4), "1.5", None, "10 00 08 00 01 04 3F C0 00 00"),
        (point(type="string", width=4, swap="words"), "ab", None, "10 00 08 00 01 04 00 00 61 62"),
        (point(type="float32", width=4, write_function="single"), "1.5", None, "10 00 08 00 01 04 3F C0 00 00"),
    ],
)
def test_a_value_is_written_where_and_as_its_point_says(at, text, functions, pdu):
    assert request((at, text), functions=functions).pdu == bytes.fromhex(pdu)


@pytest.mark.parametrize(
    ("at", "text", "pdu"),
    [
        (point(bits=(3, 3)), "on", "16 00 08 FF F7 00 08"),
        (point(bits=(3, 3)), "0", "16 00 08 FF F7 00 00"),
        (point(bits=(4, 6)), "5", "16 00 08 FF 8F 00 50"),
        (point(bits=(8, 15), type="uint8"), "255", "16 00 08 00 FF FF 00"),
        (point(bits=(0, 7), type="int8"), "-1", "16 00 08 FF 00 00 FF"),
        (point(bits=(3, 3), swap="bytes"), "on", "16 00 08 F7 FF 08 00"),
        (point(bits=(3, 3), write_at=120), "on", "16 00 78 FF F7 00 08"),
        (point(bits=(3, 3), area=Area.INPUT, write_at=120), "on", "16 00 78 FF F7 00 08"),
        (point(bits=(17, 18), type="uint32", count=2), "2", "16 00 08 FF F9 00 04"),
        (point(bits=(1, 2), type="uint32", count=2), "2", "16 00 09 FF F9 00 04"),
        (point(bits=(17, 18), type="uint32", count=2, swap="words"), "2", "16 00 09 FF F9 00 04"),
        (point(bits=(17, 18), type="uint32", count=2, swap="both"), "2", "16 00 09 F9 FF 04 00"),
        (point(bits=(4, 6), labels={2: "eco"}), "eco", "16 00 08 FF 8F 00 20"),
    ],
)
def test_bits_are_written_with_a_mask_that_keeps_all_others(at, text, pdu):
    write = request((at, text), functions=MASKING)
    assert write == Write(bytes.fromhex(pdu), Span(Area.HOLDING, int(pdu[3:8].replace(" ", ""), 16), 1))


@pytest.mark.parametrize(
    ("how", "functions", "multiple", "function"),
    [
        ("auto", None, False, 6),
        ("auto", {3, 6}, False, 6),
        ("auto", {3, 16}, False, 16),
        ("multiple", None, False, 16),
        ("auto", None, True, 16),
        ("single", {3, 6, 22}, False, 0),
    ],
)
def test_a_device_that_may_not_know_22_gets_a_read_and_a_write(how, functions, multiple, function):
    at = point(bits=(3, 3), write_function=how)
    write = request((at, "on"), functions=functions, multiple=multiple)
    assert repr(write.in_one_turn) == str(function)  # a plain number: the log shows it as it is


@pytest.mark.parametrize(
    ("at", "remedy"),
    [
        (Point("a", Area.HOLDING, 8), "write = true"),
        (Point("a", Area.INPUT, 8), "write = true and write_at = ADDRESS"),
    ],
)
def test_how_a_read_only_point_becomes_writable(at, remedy):
    assert to_be_writable(at) == remedy


def test_values_that_lie_side_by_side_are_one_request():
    first, second = point("a", write_at=100), point("b", address=3, type="int32", count=2, write_at=101)
    write = request((second, "2"), (first, "1"))
    assert write == Write(bytes.fromhex("10 00 64 00 03 06 00 01 00 00 00 02"), Span(Area.HOLDING, 100, 3))


@pytest.mark.parametrize(
    ("points", "limits", "complaint"),
    [
        ([point("a"), point("b", address=10)], {}, "side by side"),
        ([point("a"), point("b", address=9, write_at=20)], {}, "side by side"),
        ([point("a"), point("b", Area.COILS, 9, type="bit")], {}, "side by side"),
        ([point("a"), point("b", address=9, type="uint32", width=4)], {}, "side by side"),
        ([point("a", bits=(3, 3)), point("b", bits=(4, 4))], {}, "written alone"),
        ([point("a"), point("b", address=9, bits=(4, 4))], {}, "written alone"),
        ([point("a", bits=(15, 16), type="uint32", count=2)], {}, "bits of one register of 16 bits"),
        ([point("a", bits=(3, 3), type="uint32", width=4)], {}, "bits of one register of 16 bits"),
        ([point("a", type="uint32", count=2)], {16: 1}, "2 registers are too many for one request; write at most 1"),
        ([point("a"), point("b", address=9, write_function="single")], {}, "wants function 06, which writes one"),
        ([point("a", area=Area.INPUT)], {}, "input cannot be written; coils and holding can"),
        ([point("a", area=Area.DISCRETE, type="bit")], {}, "discrete cannot be written"),
        ([point(str(at), address=at, type="uint32", width=4) for at in range(62)], {}, "at most 61"),
    ],
)
def test_what_one_request_cannot_write_is_refused(points, limits, complaint):
    with pytest.raises(DoesNotFit, match=complaint):
        request(*((each, "1") for each in points), limits=limits)


@pytest.mark.parametrize(
    ("at", "pdus"),
    [
        (point(), ["06 0008 0000", "10 0008 0001 02 0000"]),
        (point(type="uint32", count=2, write_at=0x20), 2 * ["10 0020 0002 04 00000000"]),
        (point(area=Area.COILS), ["05 0008 0000", "0F 0008 0001 01 00"]),
        (point(bits=(3, 3)), ["16 0008 FFFF 0000"]),
    ],
)
def test_the_requests_that_would_write_a_point(at, pdus):
    assert writes_of(at) == [bytes.fromhex(each) for each in pdus]
