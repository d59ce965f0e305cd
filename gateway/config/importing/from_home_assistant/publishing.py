"""The [mqtt] with which the entities come back to Home Assistant: a suggestion, in comments."""

from collections.abc import Iterable, Iterator

from gateway.config.importing.from_home_assistant.device import DevicePart
from gateway.config.reading.toml_text import Value, value_text


def suggestion(devices: Iterable[DevicePart]) -> tuple[str, ...]:
    """Write the lines of the suggestion; none if nothing is read."""
    rows = [row for device in devices for row in _rows(device)]
    if not rows:
        return ()
    can_write = any("write" in keys for device in devices for keys in _points(device).values())
    return (
        "With these lines, and the address of the broker, all points come back to Home Assistant by MQTT discovery.",
        "Its own modbus: section must not ask the same devices then.",
        "[mqtt]",
        'broker         = "mqtt://127.0.0.1:1883"',
        "home_assistant = true",
        *(["write          = true"] if can_write else []),
        "publish        = [",
        *(f"  {value_text(row)}," for row in rows),
        "]",
    )


def _points(device: DevicePart) -> dict[str, dict[str, Value]]:
    return {str(point.keys["name"]): point.keys for point in device.profile.points if point.keys is not None}


def _rows(device: DevicePart) -> Iterator[dict[str, Value]]:
    """Make a row for the points that are asked equally often; Home Assistant's 0 is never."""
    names = [name for name in _points(device) if device.intervals[name]]
    intervals = sorted({device.intervals[name] for name in names})
    for interval in intervals:
        some: list[Value] = [name for name in names if device.intervals[name] == interval]
        points: dict[str, Value] = {} if len(some) == len(_points(device)) else {"points": some}
        yield {"device": device.name, **points, "every": f"{interval} s"}
