"""The devices behind a connection of Home Assistant: units, with the points of all entities that name them."""

import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from gateway.config.importing.from_home_assistant.entities import KINDS, Found
from gateway.config.importing.from_home_assistant.fields import Documents, Fields, fields_of
from gateway.config.importing.imported import ImportedFileError, take_name
from gateway.config.importing.points import PointNames, PointRow, ProfilePart, on_one_line, slug
from gateway.config.reading.toml_text import Value
from gateway.config.values.reserved_names import RESERVED

#: How often Home Assistant asks, in seconds.
_INTERVAL: Final = 15
_LONGEST_INTERVAL: Final = 24 * 3600
_MOST_POINTS: Final = 10_000
_HIGHEST_UNIT: Final = 255
#: Keys that say nothing of registers.
_WITHOUT_MEANING: Final = frozenset(
    (
        "name",
        "unique_id",
        "device_class",
        "state_class",
        "lazy_error_count",
        "icon",
        "temp_step",
        "min_temp",
        "max_temp",
    )
)


@dataclass(slots=True)
class Taken:
    """Names, units of clients, and connections that are used already, and how many points there are."""

    names: set[str] = field(default_factory=lambda: {*RESERVED, "generic"})
    units: set[int] = field(default_factory=set)
    targets: dict[str, str] = field(default_factory=dict)
    points: int = 0

    def name(self, wanted: str) -> str:
        """Take a name like this one, in letters and digits of ASCII: it is that of a profile too."""
        plain = unicodedata.normalize("NFKD", wanted).encode("ascii", "ignore").decode()
        base = slug(plain).replace(".", "-").replace("*", "").strip("-") or "device"
        return take_name(base, self.names)

    def client_unit(self, unit: int) -> bool:
        """Take a unit for clients, if it is free."""
        is_free = unit not in (0, *self.units)
        self.units.add(unit)
        return is_free


@dataclass(slots=True)
class DevicePart:
    """A unit: its profile with its points, and how often each of them is asked, in seconds; 0 is never."""

    unit: int
    profile: ProfilePart
    intervals: dict[str, int] = field(default_factory=dict)
    _names: PointNames = field(default_factory=PointNames)

    @property
    def name(self) -> str:
        """Its name, and that of its profile."""
        return self.profile.name

    def row(self, taken: Taken) -> dict[str, Value]:
        """Make its row in the table of the line or upstream."""
        numbers: dict[str, Value] = {"unit": self.unit}
        numbers |= {} if taken.client_unit(self.unit) else {"as": "none"}
        return {**numbers, "name": self.name, "profile": self.name}

    def add(self, kind: str, entity: Fields, make: Callable[[Fields], Iterator[Found]]) -> int:
        """Add the points of an entity, or a comment that says why there are none. Return how many these are."""
        place = f"{entity.where}: {kind}"
        try:
            wanted, interval = entity.text("name", kind), entity.whole("scan_interval", _INTERVAL)
            place = f'{place} "{on_one_line(wanted)}"'
            found = [*make(entity)]
        except ImportedFileError as wrong:
            self.profile.points.append(PointRow(place, why=str(wrong)))
            return 1
        unread = ", ".join(entity.unread(_WITHOUT_MEANING))
        for index, point in enumerate(found):
            name = self._names.name(f"{wanted}{point.suffix}", f"{kind.replace(' ', '-')}{point.suffix}")
            remarks = (point.remark, f"ignored: {unread}" if unread and not index else "")
            keys: dict[str, Value] = {"name": name, **point.keys}
            self.profile.points.append(PointRow(place, keys, "; ".join(filter(None, remarks))))
            self.intervals[name] = min(interval, _LONGEST_INTERVAL)
        return len(found)


def devices_of(fields: Fields, hub: str, documents: Documents, taken: Taken, *, is_line: bool) -> list[DevicePart]:
    """Make the devices of a connection that is called `hub`, in the order of their units."""
    devices: dict[int, DevicePart] = {}
    lost: list[PointRow] = []
    for kind, make, value in _entities(fields):
        try:
            entity = fields_of(value, documents)
            unit = _unit(entity, is_line=is_line)
        except ImportedFileError as wrong:
            lost.append(PointRow(f"{getattr(value, 'where', fields.where)}: {kind}", why=str(wrong)))
            continue
        device = devices.setdefault(unit, DevicePart(unit, ProfilePart("", {"title": hub}, [])))
        taken.points += device.add(kind, entity, make)
        if taken.points > _MOST_POINTS:
            raise ImportedFileError(f"there are more than {_MOST_POINTS} points")
    if not devices:
        raise ImportedFileError("; ".join(row.why for row in lost) or "it has no entities")
    in_order = [device for _, device in sorted(devices.items())]
    for device in in_order:
        device.profile.name = taken.name(hub if len(devices) == 1 else f"{hub}-{device.unit}")
    in_order[0].profile.points[:0] = lost
    return in_order


def _entities(fields: Fields) -> Iterator[tuple[str, Callable[[Fields], Iterator[Found]], object]]:
    for key, (kind, make) in KINDS.items():
        for value in fields.rows(key):
            yield kind, make, value


def _unit(entity: Fields, *, is_line: bool) -> int:
    """Return the unit of an entity."""
    unit = entity.whole("device_address", entity.whole("slave", 1))
    if unit > _HIGHEST_UNIT:
        raise ImportedFileError(f"{unit} is no unit")
    if is_line and unit == 0:
        raise ImportedFileError("unit 0 is that of all devices on a line")
    return unit
