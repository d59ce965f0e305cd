"""Sparkplug B 3.0: the gateway as an edge node, and its devices as the node's devices.

Chapter numbers are those of the specification. Messages tell a host what there is (birth), what changes (data), and
when it ends (death). Nothing here has a clock; times are Unix times in seconds.
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from sys import float_info
from typing import Final

from gateway.plant.messages import (
    Command,
    Delivery,
    DeviceState,
    Leave,
    Message,
    Misdirected,
    Reading,
    Readings,
    Rebirth,
    Received,
    Record,
)
from gateway.plant.sparkplug_payload import DataType, Metric, Payload, decode, encode, signed
from gateway.plant.topics import SparkplugTopics
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers.datatypes import Value

_REBIRTH: Final = "Node Control/Rebirth"
#: The number of the session, in its birth and its death. It counts from 0 to 255, as the numbers of messages do.
_SESSION: Final = "bdSeq"
_NUMBERS: Final = 256

#: Commands with more bytes are ignored: nothing else runs while they are decoded.
_LARGEST_COMMAND: Final = 8192

#: UInt32 is left out: some hosts read its value from one field of the message only, some from another.
_TYPES: Final = {
    "uint16": DataType.UINT16,
    "int16": DataType.INT16,
    "uint32": DataType.INT64,
    "int32": DataType.INT32,
    "uint64": DataType.UINT64,
    "int64": DataType.INT64,
    "float32": DataType.FLOAT,
    "float64": DataType.DOUBLE,
    "bcd16": DataType.UINT16,
    "bcd32": DataType.INT64,
    "int8": DataType.INT8,
    "uint8": DataType.UINT8,
    "string": DataType.STRING,
}

_FLOATS: Final = (DataType.FLOAT, DataType.DOUBLE)
#: The least and the greatest value of a type.
_LIMITS: Final[Mapping[DataType, tuple[float, float]]] = {
    DataType.BOOLEAN: (0, 1),
    DataType.FLOAT: (-3.4028235e38, 3.4028235e38),
    DataType.DOUBLE: (-float_info.max, float_info.max),
    **{
        data_type: (0, 2**bits - 1) if data_type.name.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        for data_type in _TYPES.values()
        for bits in (8, 16, 32, 64)
        if data_type.name.endswith(f"INT{bits}")
    },
}


class Sparkplug:
    """A form of messages: see `Form`. `node` is unique in its `group`; `devices` are those that are published.

    With a `primary_host` nothing is published before that host says that it is online, and the session ends when it
    goes offline. `withdrawals` take back what was announced in another form: they are published once in each session,
    after the births, which must come first.
    """

    #: Whether the broker is to publish the will at a proper end too, as 6.4.25 demands with MQTT 5.
    leaves_with_will: Final = True

    #: Its hosts may send commands as soon as they have seen a birth.
    takes_commands_first = True

    def __init__(
        self,
        group: str,
        node: str,
        devices: Sequence[PublishedDevice],
        primary_host: str | None = None,
        withdrawals: Sequence[Message] = (),
    ) -> None:
        self._topics = SparkplugTopics(group, node)
        self._host = None if primary_host is None else self._topics.state(primary_host)
        self._host_seen = -1
        self._host_is_online = primary_host is None
        self._session = _NUMBERS - 1
        self._sequence = 0
        self._devices = devices
        self._is_born = False
        self._born: set[str] = set()
        self._withdrawals = withdrawals
        self._not_withdrawn: Iterator[Message] = iter(())

    @property
    def is_held(self) -> bool:
        """Whether the primary host is offline (5.4)."""
        return not self._host_is_online

    def will(self, at: float) -> Message:
        """Return the death of the node; start a new session."""
        self._session = (self._session + 1) % _NUMBERS
        self._host_is_online = self._host is None
        self._host_seen = -1
        self._is_born = False
        self._born.clear()
        self._not_withdrawn = iter(self._withdrawals)
        return self._death(at)

    def early_subscriptions(self) -> Sequence[str]:
        """Return the topics of the primary host's state, and of commands for the node, which write nothing."""
        return [*([] if self._host is None else [self._host]), self._topics.of("NCMD")]

    def command_subscriptions(self) -> Sequence[str]:
        """Return the topics of commands for devices that have a point to write."""
        return [
            self._topics.of("DCMD", device.name)
            for device in self._devices
            if any(point.is_writable for point in device.points)
        ]

    def born(self, states: Iterable[DeviceState], at: float) -> Iterable[Message]:
        """Yield the birth of the node and of each device that answers, then the withdrawals."""
        self._sequence = 0
        self._is_born = True
        self._born.clear()
        metrics = (
            Metric(_SESSION, self._session, DataType.INT64, at),
            Metric(_REBIRTH, value=False, data_type=DataType.BOOLEAN, at=at),
        )
        yield self._message(self._topics.of("NBIRTH"), Payload(metrics, at, self._next()))
        for state in states:
            if state.is_available:
                yield self._birth(state, at)
        yield from self._not_withdrawn

    def values(
        self, device: PublishedDevice, readings: Readings, changed: Collection[str], at: float
    ) -> Sequence[Message]:
        """Return new values of a device that is born; null for those that are not known any more."""
        points = [point for point in device.points if point.name in changed]
        if device.name not in self._born or not points:
            return []
        metrics = _metrics(points, readings, at)
        payload = encode(Payload(metrics, at, self._next()), with_units=False)
        told = {name: readings[name] for name in changed if name in readings}
        return [Message(self._topics.of("DDATA", device.name), payload, qos=0, device=device.name, told=told)]

    def availability(self, state: DeviceState, at: float) -> Sequence[Message]:
        """Return the birth or the death of a device."""
        if state.is_available:
            return [self._birth(state, at)]
        if state.device.name not in self._born:
            return []
        self._born.discard(state.device.name)
        return [self._message(self._topics.of("DDEATH", state.device.name), Payload((), at, self._next()))]

    def may_tell(self, device: str) -> bool:
        """Tell whether a device is born, or is none of the node's at all."""
        return device in self._born or all(each.name != device for each in self._devices)

    def history(self, device: str, records: Sequence[Record], at: float) -> Message | None:
        """Return historical values of a device; None if it has none of these points any more.

        A value that was kept under another type of its point is left out.
        """
        points = {point.name: point for each in self._devices if each.name == device for point in each.points}
        metrics = [
            _metric(points[name], {name: Reading(value, record.at)}, at)._replace(is_historical=True)
            for record in records
            for name, value in record.values.items()
            if name in points and _fits(value, points[name].point)
        ]
        if not metrics:
            return None
        payload = encode(Payload(tuple(metrics), at, self._next()), with_units=False)
        return Message(self._topics.of("DDATA", device), payload, qos=0)

    def received(self, delivery: Delivery) -> Sequence[Received]:
        """Return what a state of the primary host or a command asks for: a birth, the end, or writes."""
        if delivery.topic == self._host:
            return self._host_tells(delivery.payload)
        if len(delivery.payload) > _LARGEST_COMMAND:
            return []
        try:
            metrics = decode(delivery.payload).metrics
        except ValueError:
            return []
        if delivery.topic == self._topics.of("NCMD"):
            is_wanted = any(metric.name == _REBIRTH and metric.value is True for metric in metrics)
            return [Rebirth()] if is_wanted and not self.is_held else []
        for device in self._devices:
            if delivery.topic == self._topics.of("DCMD", device.name):
                return list(_commands(device, metrics, delivery))
        return []

    def result(self, command: Command | Misdirected, error: str | None, at: float) -> Sequence[Message]:  # noqa: ARG002
        """Return nothing: a host sees by the next value whether its command was carried out."""
        return []

    def ended(self, at: float) -> Sequence[Message]:
        """Return the death of the node: at a proper end, the broker does not publish it with MQTT 3.1.1."""
        return [self._death(at)] if self._is_born else []

    def _host_tells(self, payload: bytes) -> Sequence[Received]:
        """Take a state of the primary host; return what it asks for. States older than the last one are ignored."""
        state = _state(payload)
        if state is None or state[1] < self._host_seen:
            return []
        was_online = self._host_is_online
        self._host_is_online, self._host_seen = state
        if self._host_is_online:
            return [] if was_online else [Rebirth()]
        return [Leave()] if was_online else []

    def _birth(self, state: DeviceState, at: float) -> Message:
        """Make the birth of a device: all of its metrics with their types, and values if they are known."""
        self._born.add(state.device.name)
        metrics = _metrics(state.device.points, state.readings, at)
        message = self._message(self._topics.of("DBIRTH", state.device.name), Payload(metrics, at, self._next()))
        return replace(message, device=state.device.name, told=state.readings)

    def _death(self, at: float) -> Message:
        metric = Metric(_SESSION, self._session, DataType.INT64, at)
        return Message(self._topics.of("NDEATH"), encode(Payload((metric,), at), with_units=True), qos=1)

    def _next(self) -> int:
        """Return the number of the next message."""
        number = self._sequence
        self._sequence = (number + 1) % _NUMBERS
        return number

    @staticmethod
    def _message(topic: str, payload: Payload) -> Message:
        return Message(topic, encode(payload, with_units=True), qos=0)


def _commands(device: PublishedDevice, metrics: Iterable[Metric], delivery: Delivery) -> Iterable[Command]:
    """Yield the commands of a host to a device. Metrics that the device does not have are ignored."""
    for metric in metrics:
        point = device.point(metric.name)
        if point is not None:
            yield Command(device, point, _text(point, metric), delivery, _refusal(point, metric, delivery))


def _refusal(point: PublishedPoint, metric: Metric, delivery: Delivery) -> str:
    """Say why a command must not be carried out; empty if it may."""
    if delivery.is_retained or delivery.is_duplicate:
        return "the message is retained or repeated: it may be an old one"
    if metric.is_historical:
        return "it is a value of earlier"
    if not point.is_writable:
        return f"{point.name} must not be written"
    if metric.value is None:
        return "it has no value"
    return ""


def _text(point: PublishedPoint, metric: Metric) -> str:
    """Format the value of a metric as a user would type it."""
    value = metric.value
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int):
        return str(signed(value, metric.data_type or _type(point.point)))
    return "" if value is None else str(value)


def _metrics(points: Iterable[PublishedPoint], readings: Readings, at: float) -> tuple[Metric, ...]:
    """Make the metrics of points, the oldest values first (6.4.6)."""
    return tuple(sorted((_metric(point, readings, at) for point in points), key=lambda metric: metric.at or at))


def _metric(published: PublishedPoint, readings: Readings, at: float) -> Metric:
    """Make the metric of a point, with its last value if that is known."""
    point, reading = published.point, readings.get(published.name)
    if reading is None or reading.value is None:
        return Metric(point.name, None, _type(point), at if reading is None else reading.at, point.unit)
    # A number without a label is text too, as the others of its point are.
    value = str(reading.value) if point.labels else reading.value
    return Metric(point.name, value, _type(point), reading.at, point.unit)


def _type(point: Point) -> DataType:
    """Return the type of the metric for a point. Labels are text, scaled numbers may have decimals or any size."""
    if point.labels:
        return DataType.STRING
    if point.is_bit:
        return DataType.BOOLEAN
    is_scaled = point.scale != 1 or point.offset or point.scale_at is not None
    return DataType.DOUBLE if is_scaled else _TYPES[point.type]


def _fits(value: Value | None, point: Point) -> bool:
    """Tell whether a value can be one of a point, which may have been another when it was read."""
    if value is None or point.labels:
        return True
    data_type = _type(point)
    if isinstance(value, str) or data_type is DataType.STRING:
        return isinstance(value, str) and data_type is DataType.STRING
    least, most = _LIMITS[data_type]
    return least <= value <= most and (isinstance(value, int) or data_type in _FLOATS)


def _state(payload: bytes) -> tuple[bool, int] | None:
    """Read whether a host is online, and since when (ms); None if the payload is not valid (6.4.24)."""
    try:
        told = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(told, dict):
        return None
    is_online, timestamp = told.get("online"), told.get("timestamp")
    if not isinstance(is_online, bool) or isinstance(timestamp, bool) or not isinstance(timestamp, int):
        return None
    return is_online, timestamp
