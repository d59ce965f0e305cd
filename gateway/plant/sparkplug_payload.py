"""Payloads of Sparkplug B: their content, and their encoding.

Their schema is the message `Payload` of sparkplug_b.proto (Sparkplug 3.0, 6.4); names and numbers of fields and types
are its own. Payloads are written with the fields that an edge node needs. Whatever else a payload has is skipped when
it is read, as the encoding (Protocol Buffers, version 2) allows.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, lru_cache
from struct import Struct
from typing import Final, NamedTuple

from gateway.registers.datatypes import decode as decode_registers


class DataType(IntEnum):
    """The type of a metric."""

    INT8 = 1
    INT16 = 2
    INT32 = 3
    INT64 = 4
    UINT8 = 5
    UINT16 = 6
    UINT32 = 7
    UINT64 = 8
    FLOAT = 9
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12


_Value = bool | float | str

#: The number of bits of each signed type.
_SIGNED: Final = {DataType.INT8: 8, DataType.INT16: 16, DataType.INT32: 32, DataType.INT64: 64}

_LONG: Final = (DataType.INT64, DataType.UINT64)

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_FLOAT: Final = Struct("<f")
_DOUBLE: Final = Struct("<d")
_LONGEST_VARINT: Final = 10


class _PayloadField(IntEnum):
    TIMESTAMP = 1
    METRICS = 2
    SEQ = 3


class _MetricField(IntEnum):
    NAME = 1
    TIMESTAMP = 3
    DATATYPE = 4
    IS_HISTORICAL = 5
    IS_NULL = 7
    PROPERTIES = 9
    INT = 10
    LONG = 11
    FLOAT = 12
    DOUBLE = 13
    BOOLEAN = 14
    STRING = 15


# Payload.PropertySet and PropertyValue
_KEYS, _VALUES, _PROPERTY_TYPE, _PROPERTY_STRING = 1, 2, 1, 8


class Metric(NamedTuple):
    """A value with its name and type. `at` is a Unix time in seconds, `unit` a property.

    A historical one is no present value: it tells what was read `at` that time.
    A metric without a value is encoded as null. In payloads that were read, whole numbers have no sign yet (see
    `signed`), and the type is None if the payload does not tell it.
    """

    name: str
    value: _Value | None
    data_type: DataType | None
    at: float | None = None
    unit: str = ""
    is_historical: bool = False


@dataclass(frozen=True, slots=True)
class Payload:
    """The content of a message: metrics, when it was sent (a Unix time in seconds), its number from 0 to 255."""

    metrics: tuple[Metric, ...]
    at: float | None = None
    seq: int | None = None


def signed(value: int, data_type: DataType) -> int:
    """Give a whole number that was read the sign that it has in `data_type`."""
    bits = _SIGNED.get(data_type)
    if bits is None:
        return value
    low = value & ((1 << bits) - 1)
    return low - (1 << bits) if low >> (bits - 1) else low


def encode(payload: Payload, *, with_units: bool) -> bytes:
    """Encode a payload; each metric tells its unit if `with_units`."""
    parts = [] if payload.at is None else [_number(_PayloadField.TIMESTAMP, _milliseconds(payload.at))]
    for metric in payload.metrics:
        body = _metric(metric, with_units=with_units)
        parts += (_METRIC, _varint(len(body)), body)
    if payload.seq is not None:
        parts.append(_number(_PayloadField.SEQ, payload.seq))
    return b"".join(parts)


def decode(data: bytes) -> Payload:
    """Decode a payload.

    Raises:
        ValueError: it is not valid.
    """
    at: float | None = None
    seq: int | None = None
    metrics = []
    for field, value in _fields(data):
        match field:
            case _PayloadField.METRICS:
                metrics.append(_read_metric(_as_bytes(value)))
            case _PayloadField.TIMESTAMP:
                at = _as_number(value) / 1000
            case _PayloadField.SEQ:
                seq = _as_number(value)
    return Payload(tuple(metrics), at, seq)


def _metric(metric: Metric, *, with_units: bool) -> bytes:
    body = _name(metric.name)
    if metric.at is not None:
        body += _time(_milliseconds(metric.at))
    if metric.data_type is not None:
        body += _type_of(metric.data_type)
    if metric.is_historical:
        body += _HISTORICAL
    if metric.value is None:
        body += _NULL
    if with_units and metric.unit:
        body += _unit(metric.unit)
    return body if metric.value is None else body + _value(metric.value, metric.data_type)


def _value(value: _Value, data_type: DataType | None) -> bytes:
    if isinstance(value, str):
        return _bytes(_MetricField.STRING, value.encode())
    if data_type is DataType.FLOAT:
        return _FLOAT_VALUE + _FLOAT.pack(value)
    if data_type is DataType.DOUBLE:
        return _DOUBLE_VALUE + _DOUBLE.pack(value)
    if data_type is DataType.BOOLEAN:
        return _BOOLEAN_VALUE + _varint(int(bool(value)))
    if data_type in _LONG:
        return _LONG_VALUE + _varint(int(value) & 0xFFFF_FFFF_FFFF_FFFF)
    return _INT_VALUE + _varint(int(value) & 0xFFFF_FFFF)


# What many metrics have in common is made once: a birth may have thousands, and nothing else runs meanwhile.


@lru_cache(maxsize=4096)
def _name(name: str) -> bytes:
    return _bytes(_MetricField.NAME, name.encode())


@lru_cache(maxsize=16)
def _time(milliseconds: int) -> bytes:
    return _number(_MetricField.TIMESTAMP, milliseconds)


@cache
def _type_of(data_type: DataType) -> bytes:
    return _number(_MetricField.DATATYPE, data_type)


@lru_cache(maxsize=256)
def _unit(unit: str) -> bytes:
    """Encode the property that names the unit."""
    value = _number(_PROPERTY_TYPE, DataType.STRING) + _bytes(_PROPERTY_STRING, unit.encode())
    return _bytes(_MetricField.PROPERTIES, _bytes(_KEYS, b"engUnit") + _bytes(_VALUES, value))


def _milliseconds(at: float) -> int:
    return round(at * 1000)


def _number(field: int, value: int) -> bytes:
    return _key(field, _VARINT) + _varint(value)


def _bytes(field: int, value: bytes) -> bytes:
    return _key(field, _BYTES) + _varint(len(value)) + value


def _key(field: int, wire_type: int) -> bytes:
    return _varint(field << 3 | wire_type)


def _varint(value: int) -> bytes:
    """Encode seven bits in each byte, the lowest first; all bytes but the last have the highest bit."""
    if value <= 0x7F:
        return _ONE_BYTE[value]
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


_ONE_BYTE: Final = [bytes((value,)) for value in range(0x80)]
_METRIC: Final = _key(_PayloadField.METRICS, _BYTES)
_HISTORICAL: Final = _number(_MetricField.IS_HISTORICAL, 1)
_NULL: Final = _number(_MetricField.IS_NULL, 1)
_INT_VALUE: Final = _key(_MetricField.INT, _VARINT)
_LONG_VALUE: Final = _key(_MetricField.LONG, _VARINT)
_FLOAT_VALUE: Final = _key(_MetricField.FLOAT, _FIXED32)
_DOUBLE_VALUE: Final = _key(_MetricField.DOUBLE, _FIXED64)
_BOOLEAN_VALUE: Final = _key(_MetricField.BOOLEAN, _VARINT)


def _read_metric(data: bytes) -> Metric:
    name = ""
    value: _Value | None = None
    data_type: DataType | None = None
    at: float | None = None
    is_historical = False
    for field, read in _fields(data):
        match field:
            case _MetricField.NAME:
                name = _as_bytes(read).decode()
            case _MetricField.TIMESTAMP:
                at = _as_number(read) / 1000
            case _MetricField.DATATYPE:
                data_type = _type(_as_number(read))
            case _MetricField.IS_HISTORICAL:
                is_historical = bool(_as_number(read))
            case _:
                value = _read_value(field, read, value)
    return Metric(name, value, data_type, at, is_historical=is_historical)


def _read_value(field: int, read: int | bytes, before: _Value | None) -> _Value | None:
    """Return the value in a field; the value `before` it if the field has none."""
    match field:
        case _MetricField.INT | _MetricField.LONG:
            return _as_number(read)
        case _MetricField.FLOAT:
            return decode_registers(_of_size(read, _FLOAT.size)[::-1], "float32")
        case _MetricField.DOUBLE:
            (value,) = _DOUBLE.unpack(_of_size(read, _DOUBLE.size))
            return float(value)
        case _MetricField.BOOLEAN:
            return bool(_as_number(read))
        case _MetricField.STRING:
            return _as_bytes(read).decode()
    return before


def _fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield the fields of a message: numbers as such, all else as bytes."""
    at = 0
    while at < len(data):
        key, at = _read_varint(data, at)
        field, wire_type = key >> 3, key & 0x07
        if wire_type == _VARINT:
            number, at = _read_varint(data, at)
            yield field, number
            continue
        if wire_type == _BYTES:
            size, at = _read_varint(data, at)
        elif wire_type == _FIXED64:
            size = _DOUBLE.size
        elif wire_type == _FIXED32:
            size = _FLOAT.size
        else:
            raise ValueError(f"wire type {wire_type}")
        if at + size > len(data):
            raise ValueError("it ends within a field")
        yield field, data[at : at + size]
        at += size


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    """Return the number that starts `at`, and where it ends."""
    value = 0
    for index in range(_LONGEST_VARINT):
        if at + index >= len(data):
            raise ValueError("it ends within a number")
        byte = data[at + index]
        value |= (byte & 0x7F) << 7 * index
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, at + index + 1
    raise ValueError("a number has more than ten bytes")


def _type(number: int) -> DataType | None:
    return DataType(number) if number in DataType.__members__.values() else None


def _as_number(value: int | bytes) -> int:
    if isinstance(value, bytes):
        raise ValueError("bytes stand where a number should")  # noqa: TRY004 - one error for all
    return value


def _as_bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("a number stands where bytes should")  # noqa: TRY004 - one error for all
    return value


def _of_size(value: int | bytes, size: int) -> bytes:
    data = _as_bytes(value)
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes stand where {size} should")
    return data
