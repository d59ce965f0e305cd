"""How long `keep` lasts while the broker is away, if every point changes each time that it is read."""

from typing import Final, NamedTuple

from gateway.config.plan.settings import MqttPlan
from gateway.profiles.published import PublishedDevice, PublishedPoint

#: Bytes of the file for the values of a device in one `keep_every`, and further ones for each value: the most that was
#: measured. Compressed text of a number is shorter the fewer digits change; that of a float64 is the longest.
_ROW: Final = 220
_VALUE: Final = 12
_FLOAT64: Final = 20


class Outage(NamedTuple):
    """`keep` is enough for so many `seconds`, at this many `values_per_s` at the most."""

    seconds: float
    values_per_s: float


def longest_outage(mqtt: MqttPlan) -> Outage | None:
    """Compute what fits into `keep` at least; None if nothing is kept."""
    points = [point for device in mqtt.devices for point in _read(device)]
    if not mqtt.keep or not points:
        return None
    rows = sum(_rows_per_s(device, mqtt.keep_every) for device in mqtt.devices)
    values = sum(_bytes(point) / point.every for point in points)
    return Outage(mqtt.keep / (_ROW * rows + values), sum(1 / point.every for point in points))


def _rows_per_s(device: PublishedDevice, keep_every: float) -> float:
    reads = sum(1 / every for every in {point.every for point in _read(device)})
    return min(1 / keep_every, reads)


def _bytes(point: PublishedPoint) -> int:
    if point.point.type == "string":
        return _VALUE + point.point.width * point.point.count
    return _FLOAT64 if point.point.type == "float64" else _VALUE


def _read(device: PublishedDevice) -> list[PublishedPoint]:
    return [point for point in device.points if point.is_readable]
