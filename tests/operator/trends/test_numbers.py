"""The numbers that trends take out of a response are the values of its points."""

from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.trends.numbers import Read, has_trend, to_number
from gateway.profiles.point import Point
from gateway.registers.datatypes import registers_of
from gateway.registers.items import pack_bits

TYPES = ("uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64", "bcd16", "bcd32")
_POINTS = st.builds(
    lambda kind, swap, scale, offset, decimals, labels, invalid: Point(
        "level",
        Area.HOLDING,
        7,
        kind,
        swap,
        registers_of(kind),
        scale=scale,
        offset=offset,
        decimals=decimals,
        labels=labels,
        invalid=invalid,
    ),
    st.sampled_from(TYPES),
    st.sampled_from(("none", "words", "bytes", "both")),
    st.sampled_from((1.0, 0.1, 0.001, 2.5, 100.0)),
    st.sampled_from((0.0, -40.0, 273.15)),
    st.sampled_from((None, 0, 1, 3)),
    st.sampled_from(({}, {0: "off", 7: "on"})),
    st.sampled_from(((), (0x8000, 0xFFFF))),
)


_HALFWAY = Point("level", Area.HOLDING, 7, "uint32", count=2, scale=0.1, offset=273.15, decimals=1)


@given(_POINTS, st.binary(min_size=8, max_size=8))
@example(_HALFWAY, bytes.fromhex("0000 0002 0000 0000"))
def test_they_are_those_that_the_point_itself_finds(point, data):
    items = data[: 2 * point.count]
    try:
        value = point.value(items)
    except ValueError:  # no BCD
        value = None
    if isinstance(value, str) or value is None or abs(value) > 1e37:
        assert to_number(point)(items) is None
    else:
        number = to_number(point)(items)
        if is_halfway(replace(point, decimals=None).value(items), point.decimals):
            assert number == pytest.approx(value, abs=1.01 * 10**-point.decimals)  # rounded up or down
        else:
            assert number == pytest.approx(value, rel=1e-12, abs=1e-9)


def is_halfway(value, decimals):
    return decimals is not None and abs(value * 10**decimals % 1 - 0.5) < 1e-6


def test_points_that_a_read_has_whole_are_found_in_it():
    points = [
        Point("a", Area.HOLDING, 10),
        Point("b", Area.HOLDING, 12, "uint32", count=2),
        Point("cut", Area.HOLDING, 13, "uint32", count=2),
        Point("scaled", Area.HOLDING, 11, "int16", scale_at=13),
        Point("far", Area.HOLDING, 11, "int16", scale_at=14),
        Point("text", Area.HOLDING, 10, "string", count=2),
        Point("bit", Area.HOLDING, 11, bits=(3, 3)),
        Point("wide bits", Area.HOLDING, 11, bits=(0, 3)),
    ]
    read = Read.of(Span(Area.HOLDING, 10, 4), points)
    response = bytes.fromhex("03 08 00 05 00 0C 00 01 FF FF")
    assert numbers(read, response) == {"a": 5, "b": 0x1FFFF, "scaled": 1.2, "bit": 1, "wide bits": 12}
    assert list(read.numbers(response[:-2])) == []


def test_bits_and_wide_registers():
    coils = Read.of(Span(Area.COILS, 3, 10), [Point("on", Area.COILS, 5), Point("off", Area.COILS, 12)])
    assert numbers(coils, b"\1\2" + pack_bits(bytes([0, 0, 1, *bytes(7)]))) == {"on": 1, "off": 0}
    labelled = Read.of(Span(Area.COILS, 0, 1), [Point("on", Area.COILS, 0, labels={1: "open"})])
    assert numbers(labelled, b"\1\1\1") == {"on": None}
    wide = Read.of(Span(Area.HOLDING, 0, 2), [Point("wide", Area.HOLDING, 1, "float32", count=1, width=4)])
    assert numbers(wide, bytes.fromhex("03 08 00000000 3F800000")) == {"wide": 1.0}


def numbers(read, response):
    return {point.name: number for point, number in zip(read.points, read.numbers(response), strict=True)}


def test_what_is_only_written_has_no_trend():
    assert not has_trend(Point("start", Area.HOLDING, 0, write="only"))
    assert has_trend(Point("level", Area.HOLDING, 0, write="yes"))
