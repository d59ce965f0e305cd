"""The bytes of payloads, against those that Google's own library writes with Eclipse Tahu's definitions."""

import random
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.plant.sparkplug_payload import DataType, Metric, Payload, decode, encode, signed

VECTORS = tomllib.loads((Path(__file__).parents[1] / "vectors" / "sparkplug.toml").read_text(encoding="utf-8"))
AT = 1700000000.123
LATER = 1700000000.128

BIRTH_OF_NODE = Payload(
    (
        Metric("bdSeq", 7, DataType.INT64, AT),
        Metric("Node Control/Rebirth", value=False, data_type=DataType.BOOLEAN, at=AT),
    ),
    AT,
    0,
)
BIRTH = Payload(
    (
        Metric("i8", -2, DataType.INT8, AT),
        Metric("i16", -1, DataType.INT16, AT),
        Metric("i32", -(2**31), DataType.INT32, AT),
        Metric("i64", -5, DataType.INT64, AT),
        Metric("u8", 200, DataType.UINT8, AT),
        Metric("u16", 65535, DataType.UINT16, AT, "rpm"),
        Metric("u32", 2**32 - 1, DataType.UINT32, AT),
        Metric("u64", 2**64 - 1, DataType.UINT64, AT),
        Metric("float", 0.1, DataType.FLOAT, AT, "°C"),
        Metric("double", 4999.66, DataType.DOUBLE, AT),
        Metric("bool", value=1, data_type=DataType.BOOLEAN, at=AT),
        Metric("text", "läuft", DataType.STRING, AT),
        Metric("null", None, DataType.FLOAT, AT),
    ),
    AT,
    255,
)
DATA = Payload(
    (
        Metric("weight", 4999.66, DataType.FLOAT, LATER, "kg"),
        Metric("state", "running", DataType.STRING, LATER),
    ),
    AT,
    2,
)
DEATH_OF_NODE = Payload((Metric("bdSeq", 0, DataType.INT64, AT),), AT)
DEATH = Payload((), AT, 9)


@pytest.mark.parametrize(
    ("name", "payload", "with_units"),
    [
        ("nbirth", BIRTH_OF_NODE, True),
        ("dbirth", BIRTH, True),
        ("ddata", DATA, False),
        ("ndeath", DEATH_OF_NODE, True),
        ("ddeath", DEATH, True),
    ],
)
def test_a_payload_has_the_bytes_that_others_write(name, payload, with_units):
    assert encode(payload, with_units=with_units).hex() == VECTORS[name]


def test_what_others_write_is_read():
    read = decode(bytes.fromhex(VECTORS["dbirth"]))
    assert (read.at, read.seq) == (AT, 255)
    for theirs, ours in zip(read.metrics, BIRTH.metrics, strict=True):
        value = theirs.value
        is_number = isinstance(value, int) and not isinstance(value, bool)
        assert (signed(value, ours.data_type) if is_number else value) == ours.value
        assert (theirs.name, theirs.data_type, theirs.at) == (ours.name, ours.data_type, AT)


def test_units_are_told_in_births_only():
    read = decode(bytes.fromhex(VECTORS["ddata"]))
    assert read.metrics == (
        Metric("weight", 4999.66, DataType.FLOAT, LATER),
        Metric("state", "running", DataType.STRING, LATER),
    )


def test_what_we_do_not_know_is_skipped():
    read = decode(bytes.fromhex(VECTORS["others"]))
    assert read.metrics == (
        Metric("speed", 2**32 - 1, DataType.INT32, AT, is_historical=True),
        Metric("table", None, None, AT),
    )


@given(st.floats(width=32, allow_nan=False), st.integers(-(2**63), 2**63 - 1), st.text())
def test_values_come_back(number, whole, text):
    metrics = (
        Metric("a", number, DataType.FLOAT),
        Metric("b", number, DataType.DOUBLE),
        Metric("c", whole, DataType.INT64),
        Metric("d", text, DataType.STRING),
    )
    a, b, c, d = (each.value for each in decode(encode(Payload(metrics), with_units=True)).metrics)
    assert (b, signed(c, DataType.INT64), d) == (number, whole, text)
    assert a == pytest.approx(number, rel=1e-6)


def test_a_float32_is_the_shortest_number():
    """Else 0.1 would be 0.10000000149011612, which is no multiple of any scale."""
    payload = Payload((Metric("a", 0.1, DataType.FLOAT),))
    assert decode(encode(payload, with_units=False)).metrics[0].value == 0.1


@pytest.mark.parametrize("name", list(VECTORS))
def test_a_damaged_payload_is_refused_or_read_but_nothing_else(name):
    """Whatever a broker delivers: ValueError is the only way out."""
    chance = random.Random(1)
    whole = bytes.fromhex(VECTORS[name])
    refused = 0
    for _ in range(2000):
        data = bytearray(whole[: chance.randrange(len(whole) + 1)])
        for _ in range(chance.randrange(3)):
            if data:
                data[chance.randrange(len(data))] = chance.randrange(256)
        try:
            decode(bytes(data))
        except ValueError:
            refused += 1
    assert refused > 100


@pytest.mark.parametrize(
    ("data", "why"),
    [
        ("12", "ends within a number"),
        ("1205", "ends within a field"),
        ("0b", "wire type 3"),
        ("09 00", "ends within a field"),
        ("80" * 11, "more than ten bytes"),
        ("0a0100", "bytes stand where a number"),
        ("1200 1001", "a number stands where bytes"),
        ("1203 0a 01 ff", "utf-8"),
        ("1206 6100000000", "ends within a field"),
        ("120a 61 0000000000000000 00", "8 bytes stand where 4"),
    ],
)
def test_what_is_no_payload_is_refused(data, why):
    with pytest.raises(ValueError, match=why):
        decode(bytes.fromhex(data))
