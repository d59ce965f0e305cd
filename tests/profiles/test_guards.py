"""Points with limits are written whole and within these, whichever function writes them, or not at all."""

from collections.abc import Iterator
from decimal import Context, Decimal
from math import isfinite
from struct import error, pack, unpack

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.errors import IllegalValue, RequestError
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.registers.masks import write_after

SPEED = Point("speed", Area.HOLDING, 10, "int32", "words", 2, 0.1, 1, "rpm", write="yes", minimum=0, maximum=1500)
MODE = Point("mode", Area.HOLDING, 8, bits=(4, 6), write="yes", maximum=5)
SOUND = Point("sound", Area.HOLDING, 12, "float32", count=2, write="yes", minimum=0, maximum=1, invalid=(0.5,))
#: Read at input 3, written at holding 100.
FLOW = Point("flow", Area.INPUT, 3, "int16", write="only", write_at=100, minimum=-5)
SHOWN = Point("shown", Area.HOLDING, 30, minimum=0, maximum=9)
DRIVE = Profile("drive").guarding([SPEED, MODE, SOUND, FLOW, SHOWN])


@pytest.mark.parametrize(
    ("pdu", "why"),
    [
        ("10 000A 0002 04 3A98 0000", None),
        ("10 000A 0002 04 3A99 0000", "speed must be 0 to 1500 rpm, not 1500.1"),
        ("10 000A 0002 04 FFFF FFFF", "speed must be 0 to 1500 rpm, not -0.1"),
        ("17 0000 0001 000A 0002 04 3A99 0000", "speed must be 0 to 1500 rpm, not 1500.1"),
        ("17 000A 0002 0020 0001 02 FFFF", None),
        ("10 0009 0004 08 0000 0000 0000 0000", "sound must be 0 to 1: one write must set all of holding 12-13"),
        ("10 0009 0003 06 0000 0000 0000", None),
        ("06 000A 0000", "speed must be 0 to 1500 rpm: one write must set all of holding 10-11"),
        ("16 000B FFFF 0000", "speed must be 0 to 1500 rpm, and function 22 does not tell what it becomes"),
        ("10 000C 0002 04 3F80 0000", None),
        ("10 000C 0002 04 3F80 0001", "sound must be 0 to 1, not 1.0000001"),
        ("10 000C 0002 04 7FC0 0000", "sound must be 0 to 1, and this is no value"),
        ("10 000C 0002 04 3F00 0000", "sound must be 0 to 1, and this is no value"),
        ("06 0008 FFDF", None),
        ("06 0008 0060", "mode must be at most 5, not 6"),
        ("06 0064 FFFA", "flow must be at least -5, not -6"),
        ("06 0003 FFFA", None),
        ("06 001E FFFF", None),
        ("10 FFFF 000A 14" + 10 * " 0000", "mode must be at most 5: one write must set all of holding 8"),
        ("17 0000 0001 FFFF 000A 14" + 10 * " 0000", "mode must be at most 5: one write must set all of holding 8"),
        ("10 FFFF 0009 12" + 9 * " FFFF", None),
        ("05 000A FF00", None),
        ("0F 0008 0008 01 FF", None),
        ("03 000A 0001", None),
    ],
)
def test_what_a_write_to_a_guarded_point_gets(pdu: str, why: str | None) -> None:
    if why is None:
        DRIVE.check(bytes.fromhex(pdu))
    else:
        with pytest.raises(IllegalValue) as caught:
            DRIVE.check(bytes.fromhex(pdu))
        assert str(caught.value) == why


def test_each_point_at_the_same_register_must_hold() -> None:
    profile = Profile("p").guarding([MODE, Point("word", Area.HOLDING, 8, write="yes", minimum=16)])
    assert passes(profile, bytes.fromhex("06 0008 0010"))
    assert not passes(profile, bytes.fromhex("06 0008 000F"))
    assert not passes(profile, bytes.fromhex("06 0008 0060"))


@pytest.mark.parametrize(
    ("swap", "register", "value"), [("none", 0x15, "0060"), ("words", 0x14, "0060"), ("both", 0x14, "6000")]
)
def test_bits_of_several_registers_are_in_one_of_them(swap: str, register: int, value: str) -> None:
    profile = Profile("p").guarding(
        [Point("x", Area.HOLDING, 20, "uint32", swap, 2, bits=(4, 6), write="yes", maximum=5)]
    )
    head = f"06 {register:04X}"
    assert not passes(profile, bytes.fromhex(f"{head} {value}"))
    assert passes(profile, bytes.fromhex(f"{head} {value.replace('6', '5')}"))
    assert passes(profile, bytes.fromhex(f"06 {0x29 - register:04X} FFFF"))


def test_a_register_of_four_bytes_is_where_it_is_in_the_request() -> None:
    point = Point("x", Area.HOLDING, WIDE + 1, "uint32", write="yes", maximum=9, width=4)
    profile = profile_with([point])
    for numbers, is_within in (((99, 9, 99), True), ((9, 10, 9), False)):
        pdu = f"10 {WIDE:04X} 0003 0C {''.join(f'{number:08X}' for number in numbers)}"
        assert passes(profile, bytes.fromhex(pdu)) == is_within


def test_labels_and_types_guard_nothing() -> None:
    points = [Point("state", Area.HOLDING, 8, "bcd16", labels={0: "off"}, write="yes"), Point("x", Area.HOLDING, 9)]
    assert type(Profile("p").guarding(points)) is Profile


def test_the_order_of_the_specification_is_kept() -> None:
    """Function, then structure, then addresses; what is written comes last."""
    profile = Profile("p", functions=frozenset({6}), areas={Area.HOLDING: ((0, 9),)}).guarding([SPEED, MODE])
    for pdu, code in (("16 0008 0000 0060", 1), ("06 000A 0000", 2), ("06 0008 0060", 3)):
        with pytest.raises(RequestError) as caught:
            profile.check(bytes.fromhex(pdu))
        assert caught.value.code == code


# --- any points, any request -------------------------------------------------------------------------

#: Registers from here on have four bytes.
WIDE = 40
_SIZES = {"uint16": 1, "int16": 1, "bcd16": 1, "uint32": 2, "int32": 2, "float32": 2, "bcd32": 2, "uint64": 4}
_SIZES |= {"int64": 4, "float64": 4, "uint8": 1, "int8": 1}
_EXACT = Context(prec=400)


@st.composite
def limited_points(draw: st.DrawFn) -> Point:
    data_type = draw(st.sampled_from(sorted(_SIZES)))
    size, is_wide = _SIZES[data_type], draw(st.booleans())
    width = 4 if is_wide and size > 1 else 2
    count = 2 * size // width
    bits = None
    if data_type in ("uint8", "int8"):
        bits = draw(st.sampled_from([(0, 7), (8, 15)]))
    elif width == 2 and data_type in ("uint16", "uint32", "uint64") and draw(st.integers(0, 2)):
        word, first = 16 * draw(st.integers(0, size - 1)), draw(st.integers(0, 14))
        bits = (word + first, word + draw(st.integers(first + 1, 15)))
    at = draw(st.integers(0, 4)) + (WIDE if width == 4 else 0)
    limits = draw(st.tuples(_limits, _limits).filter(any))
    least, greatest = limits if None in limits else sorted(limits)
    is_elsewhere = bits is None and draw(st.booleans())
    return Point(
        "p",
        Area.INPUT if is_elsewhere and draw(st.booleans()) else Area.HOLDING,
        200 if is_elsewhere else at,
        data_type,
        draw(st.sampled_from(["none", "words", "bytes", "both"])),
        count,
        scale=draw(st.sampled_from([1.0, 0.1, 0.25, -2.0, 10.0])),
        offset=draw(st.sampled_from([0.0, -40.0, 0.5])),
        invalid=draw(st.sampled_from([(), (0,), (1, 3)])) if bits is None or count == 1 else (),
        write=draw(st.sampled_from(["yes", "yes", "yes", "only", "no"])),
        bits=bits,
        minimum=least,
        maximum=greatest,
        write_at=at if is_elsewhere else None,
        width=width,
    )


_limits = st.none() | st.sampled_from([0.0, 1.0, -40.0, 0.1, 100.0, 65535.0, 3e9, -3e9, 1e30])
_registers = st.binary(min_size=2, max_size=2) | st.sampled_from(
    [
        bytes.fromhex(each)
        for each in ("0000", "0001", "0003", "0100", "0300", "FFFF", "7FC0", "C07F", "8000", "0064", "6400")
    ]
)


@st.composite
def writes(draw: st.DrawFn, points: list[Point]) -> bytes:
    """Requests to registers near those of points, and often to just those of one."""
    function = draw(st.sampled_from([5, 6, 6, 15, 16, 16, 16, 16, 22, 22, 23, 23, 3]))
    point = draw(st.sampled_from(points))
    own = own_registers(point)
    near = st.tuples(st.integers(0, 6) | st.integers(WIDE, WIDE + 3), st.integers(1, 6))
    start, count = draw(st.just((min(own), len(own))) | near)
    address, value = start.to_bytes(2, "big"), draw(_registers)
    width = 4 if start >= WIDE and function == 16 else 2
    values = b"".join(draw(_registers) for _ in range(count * width // 2))
    head = bytes((function,)) + address
    return {
        3: head + count.to_bytes(2, "big"),
        5: head + draw(st.sampled_from([b"\xff\0", b"\0\0"])),
        6: head + value,
        15: head + count.to_bytes(2, "big") + b"\1" + value[:1],
        16: head + count.to_bytes(2, "big") + bytes((len(values),)) + values,
        22: head + value + draw(_registers),
        23: b"\x17\0\0\0\1" + address + count.to_bytes(2, "big") + bytes((len(values),)) + values,
    }[function]


def profile_with(points: list[Point]) -> Profile:
    return Profile("p", wide={Area.HOLDING: ((WIDE, WIDE + 50),)}).guarding(points)


def passes(profile: Profile, pdu: bytes) -> bool:
    try:
        profile.check(pdu)
    except IllegalValue:
        return False
    return True


@settings(max_examples=600)
@given(st.data(), st.lists(limited_points(), min_size=1, max_size=4))
def test_a_write_passes_if_each_guarded_point_that_it_touches_is_whole_and_within(
    data: st.DataObject, points: list[Point]
) -> None:
    pdu = data.draw(writes(points))
    try:
        profile_with([]).check(pdu)
    except RequestError:
        return
    assert passes(profile_with(points), pdu) == all(holds(point, pdu) for point in points)


@settings(max_examples=300)
@given(st.lists(limited_points(), min_size=1, max_size=3), st.integers(0, 12), _registers, _registers, _registers)
def test_a_write_of_bits_in_one_turn_leaves_each_guarded_point_whole_and_within(
    points: list[Point], at: int, and_mask: bytes, or_mask: bytes, before: bytes
) -> None:
    profile, pdu = profile_with(points), b"\x16" + at.to_bytes(2, "big") + and_mask + or_mask
    after = write_after(pdu, int.from_bytes(before, "big"), 6)
    try:
        profile.check_in_one_turn(pdu, 6)
        is_written = passes(profile, after)
    except IllegalValue:
        is_written = False
    mask = int.from_bytes(and_mask, "big") ^ 0xFFFF
    in_parts = any(mask & own not in (0, own) for point in points for own in [bits_at(point, at)] if is_limited(point))
    assert is_written == (not in_parts and all(holds(point, after) for point in points))


@given(st.data(), st.lists(limited_points(), min_size=1, max_size=3))
def test_what_the_bits_of_a_turn_cannot_change_is_refused_before_the_read(
    data: st.DataObject, points: list[Point]
) -> None:
    """If the first look refuses, no register that the device could have would have made it pass."""
    pdu = data.draw(writes(points))
    if pdu[0] != 22 or pdu[1:3] >= WIDE.to_bytes(2, "big"):
        return
    profile = profile_with(points)
    try:
        profile.check_in_one_turn(pdu, 6)
    except IllegalValue:
        at, mask = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big") ^ 0xFFFF
        in_parts = any(mask & own not in (0, own) for each in points for own in [bits_at(each, at)] if is_limited(each))
        assert in_parts or not any(passes(profile, write_after(pdu, before, 6)) for before in range(0, 65536, 257))


# --- the reference: byte by byte, without any code of the gateway ------------------------------------


def is_limited(point: Point) -> bool:
    return point.write != "no" and (point.minimum is not None or point.maximum is not None)


def holds(point: Point, pdu: bytes) -> bool:
    """Whether a guarded point is not touched, or whole and within limits."""
    if not is_limited(point):
        return True
    written = dict(effect(pdu))
    where = own_registers(point)
    if not written.keys() & where.keys():
        return True
    if pdu[0] == 22 or not written.keys() >= where.keys():
        return False
    first = point.address if point.write_at is None else point.write_at
    items = b"".join(written.get(first + index, bytes(point.width)) for index in range(point.count))
    number = decoded(point, items)
    if number is None:
        return False
    value = _EXACT.multiply(Decimal(repr(number)), Decimal(repr(point.scale)))
    value = _EXACT.add(value, Decimal(repr(point.offset)))
    return (point.minimum is None or value >= Decimal(repr(point.minimum))) and (
        point.maximum is None or value <= Decimal(repr(point.maximum))
    )


def effect(pdu: bytes) -> Iterator[tuple[int, bytes]]:
    """The holding registers that a request writes, with their bytes."""
    function = pdu[0]
    if function in (6, 22):
        yield int.from_bytes(pdu[1:3], "big"), pdu[3:5]
    elif function in (16, 23):
        at, values = (1, 6) if function == 16 else (5, 10)
        start, count = unpack(">HH", pdu[at : at + 4])
        width = (len(pdu) - values) // count
        for index in range(count):
            yield start + index, pdu[values + index * width : values + (index + 1) * width]


def own_registers(point: Point) -> dict[int, int]:
    """The registers with bits of the point, and these bits in each as it is on the wire."""
    first = point.address if point.write_at is None else point.write_at
    if point.bits is None:
        return dict.fromkeys(range(first, first + point.count), (1 << (8 * point.width)) - 1)
    own: dict[int, int] = {}
    for bit in range(point.bits[0], point.bits[1] + 1):
        word, place = divmod(bit, 16)
        if point.swap not in ("words", "both"):
            word = point.count - 1 - word
        place = (place + 8) % 16 if point.swap in ("bytes", "both") else place
        own[first + word] = own.get(first + word, 0) | 1 << place
    return own


def bits_at(point: Point, register: int) -> int:
    return own_registers(point).get(register, 0)


def decoded(point: Point, items: bytes) -> int | float | None:
    words = [items[at : at + 2] for at in range(0, len(items), 2)]
    if point.swap in ("words", "both"):
        words.reverse()
    if point.swap in ("bytes", "both"):
        words = [word[::-1] for word in words]
    plain = b"".join(words)
    if point.bits is not None:
        whole = int.from_bytes(plain, "big")
        number = (whole >> point.bits[0]) % 2 ** (point.bits[1] - point.bits[0] + 1)
        if point.type == "int8" and number > 127:
            number -= 256
        judged = number if point.type in ("int8", "uint8") else whole
        return None if judged in point.invalid else number
    if point.type.startswith("bcd"):
        text = plain.hex()
        return None if not text.isdigit() or int(text) in point.invalid else int(text)
    code = {"uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "uint64": "Q", "int64": "q"}
    (found,) = unpack(">" + {**code, "float32": "f", "float64": "d"}[point.type], plain)
    if isinstance(found, float) and not isfinite(found):
        return None
    if point.type == "float32":
        found = next(short for digits in range(1, 18) if is_same(short := float(f"{found:.{digits}g}"), plain))
    return None if found in point.invalid else found


def is_same(number: float, plain: bytes) -> bool:
    try:
        return pack(">f", number) == plain
    except (OverflowError, error):
        return False
