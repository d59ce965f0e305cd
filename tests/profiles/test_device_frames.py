"""The points of shipped profiles mean what the documents of their devices print: frames, byte for byte."""

import tomllib
from importlib.resources import files
from itertools import chain

import pytest

from gateway.config.plan.points import points_of
from gateway.config.schema.profile import ProfileTable
from gateway.modbus import rtu
from gateway.modbus.pdu import parse_request
from gateway.profiles.point import Point
from gateway.registers.items import items_read, write_request
from kit.vectors import device_frames

READS, WRITES, ITEMS = (device_frames(kind) for kind in ("read", "write", "items"))


def shipped(name: str) -> ProfileTable:
    text = files("gateway.profiles").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return ProfileTable.model_validate(tomllib.loads(text)["profile"][name])


def point_of(profile: str, name: str) -> Point:
    kind = shipped(profile)
    (point,) = (point for point in points_of(kind.points, kind) if point.name == name)
    return point


def pdu(adu: str) -> bytes:
    data = bytes.fromhex(adu)
    assert rtu.encode(data[0], data[1:-2]) == data, "the CRC is wrong"
    return data[1:-2]


@pytest.mark.parametrize("frame", READS)
def test_a_printed_response_has_the_printed_values(frame: dict) -> None:
    span = parse_request(pdu(frame["request"])).read
    assert span is not None
    items = items_read(span, pdu(frame["response"]))
    size = len(items) // span.count
    for name, value in frame["values"].items():
        point = point_of(frame["profile"], name)
        assert (point.area, span.start <= point.address < span.end) == (span.area, True)
        start = (point.address - span.start) * size
        assert point.value(items[start : start + point.count * size]) == value


@pytest.mark.parametrize("frame", WRITES)
def test_a_value_is_written_with_the_printed_request(frame: dict) -> None:
    point = point_of(frame["profile"], frame["point"])
    span, items = point.write_span, point.items(frame["value"])
    assert write_request(span.area, span.start, items) == pdu(frame["request"])


@pytest.mark.parametrize("frame", ITEMS)
def test_explained_registers_have_the_explained_value(frame: dict) -> None:
    assert point_of(frame["profile"], frame["point"]).value(bytes.fromhex(frame["items"])) == frame["value"]


@pytest.mark.parametrize("name", sorted({parameter.values[0]["profile"] for parameter in chain(READS, WRITES)}))
def test_a_kind_with_frames_says_so(name: str) -> None:
    assert shipped(name).seen == "printed frames"
