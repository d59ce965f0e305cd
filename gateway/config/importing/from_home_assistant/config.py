"""A config out of the `modbus:` section of Home Assistant, and the [mqtt] with which its entities come back."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from gateway.config.importing.from_home_assistant.device import DevicePart, Taken
from gateway.config.importing.from_home_assistant.fields import Documents
from gateway.config.importing.from_home_assistant.hub import hub_parts
from gateway.config.importing.imported import Imported, ImportedFileError, read_file
from gateway.config.importing.points import Check, ProfilePart, write
from gateway.config.importing.yaml_text import Table
from gateway.config.reading.toml_text import TableText, Value, value_text

_SECTION: Final = "modbus"
#: What the suggestion at the end needs at the top.
_SITE: Final = ("For the [mqtt] at the end:", 'site = "home"')


def config_from_home_assistant(file: str, check: Check, read: Callable[[str], str] = read_file) -> Imported:
    """Write the config that asks the devices of this `file`."""
    documents, taken = Documents(file, read), Taken()
    parts: list[TableText | ProfilePart] = [TableText("", comments=(f"From Home Assistant: {file}", *_SITE))]
    left_out: list[str] = []
    devices: list[DevicePart] = []
    for hub in _hubs(documents):
        try:
            tables, found = hub_parts(hub, documents, taken)
        except ImportedFileError as wrong:
            left_out.append(str(wrong))
            tables, found = [TableText("", comments=(f"Left out: {wrong}",))], []
        parts += tables
        devices += found
    imported = write("", parts, check, left_out)
    lines = suggestion(devices)  # of the points that are left
    return imported._replace(text=imported.text + "".join(f"\n# {line}" for line in lines) + "\n" * bool(lines))


def _hubs(documents: Documents) -> list[Any]:
    """Find the connections: those of the section, or all that is in the file."""
    document = documents.document()
    if isinstance(document, Table) and _SECTION in document:
        document = documents.follow(document[_SECTION])
    elif isinstance(document, Table) and "type" not in document:
        document = None
    hubs = document if isinstance(document, list) else [document]
    if not hubs or hubs == [None]:
        raise ImportedFileError(f"{documents.file}: there is no {_SECTION}: in it")
    return hubs


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
