"""Any point that `check` accepts: what was read can be written again as it is shown, and nothing else is touched."""

from math import isfinite

from hypothesis import assume, given
from hypothesis import strategies as st

from gateway.modbus.codes import Area, FunctionCode
from gateway.profiles.point import Point
from gateway.profiles.writing import request_to_write, written
from gateway.registers.datatypes import BYTE_TYPES, DATA_TYPES, SWAPS, decode, encode, is_float, registers_of, swapped
from gateway.registers.items import REGISTER, WIDE_REGISTER
from gateway.registers.masks import masked

#: Above this a number of 64 bits has more digits than a float with decimals can show.
_MOST_WITH_DECIMALS = 2**50
_SCALES = st.fixed_dictionaries(
    {
        "scale": st.sampled_from([1.0, 0.1, 0.001, 0.25, 2.5, 10.0, -1.0]),
        "offset": st.sampled_from([0.0, -40.0, 0.5, 1e6]),
    }
)
_SCALED = ("uint16", "int16", "uint32", "int32", "uint64", "int64")


@st.composite
def points(draw: st.DrawFn) -> Point:
    """A point of whole registers."""
    data_type = draw(st.sampled_from([each for each in DATA_TYPES if each != "bit"]))
    size = draw(st.integers(1, 5)) if data_type == "string" else registers_of(data_type)
    width = REGISTER if size % 2 else draw(st.sampled_from([REGISTER, WIDE_REGISTER]))
    count = size * REGISTER // width
    has_scale = data_type in _SCALED and draw(st.booleans())
    return Point(
        "p",
        Area.HOLDING,
        10,
        data_type,
        draw(st.sampled_from(SWAPS)),
        count,
        **({} if data_type == "string" or is_float(data_type) else draw(_SCALES)),
        scale_at=draw(st.sampled_from([5, 9, 10 + count, 20])) if has_scale else None,
        write="yes",
        width=width,
    )


@st.composite
def points_of_bits(draw: st.DrawFn) -> Point:
    """A point that is some bits of one register, which may be one of several."""
    data_type = draw(st.sampled_from(["uint16", "uint32", "uint64", *BYTE_TYPES]))
    register = 16 * draw(st.integers(0, registers_of(data_type) - 1))
    first = draw(st.integers(0, 15))
    bits = (first, draw(st.integers(first, 15)))
    if data_type in BYTE_TYPES:
        bits = draw(st.sampled_from([(0, 7), (8, 15)]))
    return Point(
        "p",
        Area.HOLDING,
        10,
        data_type,
        draw(st.sampled_from(SWAPS)),
        registers_of(data_type),
        **({} if bits[0] == bits[1] else draw(_SCALES)),
        bits=(register + bits[0], register + bits[1]),
        write="yes",
    )


@st.composite
def with_items(draw: st.DrawFn, points: st.SearchStrategy[Point]) -> tuple[Point, bytes]:
    """A point, and what a device may have at its `read_span`."""
    point = draw(points)
    size = point.read_span.count * point.width
    items = draw(st.binary(min_size=size, max_size=size))
    size = point.count * point.width
    if point.type.startswith("bcd"):
        number = draw(st.integers(0, 10 ** (2 * size) - 1))
        items = point.around(encode(number, point.type, point.swap), items)
    elif point.type == "string":
        text = draw(st.text("abc xyzäß", max_size=size // 2)).rstrip(" ")
        items = encode(text, point.type, point.swap, size // REGISTER)
    if point.scale_at is not None:
        at = (point.scale_at - point.read_span.start) * point.width
        exponent = draw(st.integers(-4, 4)).to_bytes(2, "big", signed=True)
        items = items[:at] + exponent + items[at + 2 :]
    return point, items


def is_shown_exactly(point: Point, items: bytes) -> bool:
    """Whether the number has no more digits than its text can have."""
    if point.type == "string" or is_float(point.type):
        return True
    if point.scale == 1 and not point.offset and point.scale_at is None:
        return True
    own = swapped(point.own(items), point.swap)
    number = int.from_bytes(own, "big") if point.bits else decode(own, point.type)
    return abs(number) < _MOST_WITH_DECIMALS


@given(with_items(points() | points_of_bits()))
def test_what_was_read_can_be_written_again_as_it_is_shown(point_and_items):
    point, items = point_and_items
    value = point.value(items)
    assume(value is not None and is_shown_exactly(point, items))
    own = point.items(point.show(value), items)
    assert point.value(point.around(own, items)) == value
    number, mask = (int.from_bytes(swapped(each, point.swap), "big") for each in (own, point.own(items)))
    assert number & ~point.mask == 0
    if point.type != "string":
        assert number == mask & point.mask
    if point.type in ("float32", "float64"):
        assert isfinite(value)


@given(with_items(points_of_bits()), st.data())
def test_a_request_that_writes_bits_changes_these_and_no_others(point_and_items, data):
    point, items = point_and_items
    value = point.value(items)
    assume(value is not None and is_shown_exactly(point, items))
    before = data.draw(st.binary(min_size=len(items), max_size=len(items)))
    write = request_to_write([written(point, point.show(value))], {})
    assert (write.pdu[0], write.in_one_turn) == (FunctionCode.MASK_WRITE_REGISTER, FunctionCode.WRITE_SINGLE_REGISTER)
    at = REGISTER * (write.span.start - point.address)
    register = masked(write.pdu, int.from_bytes(before[at : at + 2], "big"))
    after = before[:at] + register.to_bytes(2, "big") + before[at + 2 :]
    assert point.value(after) == value
    numbers = [int.from_bytes(swapped(each, point.swap), "big") for each in (before, after)]
    assert (numbers[0] ^ numbers[1]) & ~point.mask == 0


@given(with_items(points()))
def test_a_request_that_writes_whole_registers_carries_what_was_read(point_and_items):
    point, items = point_and_items
    value = point.value(items)
    assume(point.type != "string" and value is not None and is_shown_exactly(point, items))
    write = request_to_write([written(point, point.show(value), items)], {})
    assert write.span == point.span
    assert write.pdu[-point.count * point.width :] == point.own(items)
