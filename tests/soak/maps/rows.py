"""Rows of a map: as the config says them, and what they should show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from gateway.modbus.codes import Area
from soak.maps.conversion import Encoding, turned
from soak.maps.devices import Point, Told

#: What has never been shown.
_UNKNOWN: Final = object()
BITS: Final = (Area.COILS, Area.DISCRETE)


@dataclass(frozen=True)
class Source:
    """What a row reads of the device with this name: some items, or a point."""

    device: str
    area: Area
    first: int
    count: int
    point: Point | None = None


@dataclass(frozen=True, eq=False)
class Row:
    """Items from `at` on in `area` show what `source` has: turned, encoded as `target`, or as it is.

    A row that `is_plain` does not say in the config how it is encoded.
    """

    area: Area
    at: int
    source: Source
    target: Encoding | None = None
    swap: str = "none"
    is_plain: bool = False
    write: bool = False
    when_stale: Literal["exception", "hold"] | int = "exception"

    @property
    def count(self) -> int:
        """So many items."""
        return self.source.count if self.target is None else self.target.count

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.at + self.count

    def shown(self, told: Told) -> tuple[int, ...] | None:
        """What it shows of what a device told of its area; None if that has no value, or does not fit."""
        found = told.shown.get(self, _UNKNOWN)
        if found is _UNKNOWN:
            first = self.source.first
            found = told.shown[self] = self.shown_of(told.items[first : first + self.source.count])
        return found  # type: ignore[return-value]

    def shown_of(self, items: Sequence[int]) -> tuple[int, ...] | None:
        """What it shows of the items of its source."""
        point = self.source.point
        if self.swap != "none":
            pairs = [turned(items[at : at + 2], self.swap) for at in range(0, len(items), 2)]
            return tuple(word for pair in pairs for word in pair)
        if point is None or point.encoding is None:
            return tuple(items)
        value = point.encoding.value(items)
        if value is None:
            return None
        if self.area in BITS:
            return (int(value),)
        return tuple(items) if self.target is None else self.target.words(value)

    def config(self, every: Mapping[Area, str]) -> str:
        """Its table in the config, with how often each area is read."""
        source, last = self.source, self.source.first + self.source.count - 1
        keys = [f'at = {self.at}, area = "{self.area}", device = "{source.device}", every = "{every[source.area]}"']
        if source.point is None:
            keys.append(f'{source.area} = "{source.first}-{last}"')
            keys += [f'swap = "{self.swap}"'] if self.swap != "none" else []
        else:
            keys.append(f'point = "{source.point.name}"')
            keys += [] if self.target is None or self.is_plain else [_encoding(self.target)]
        keys += ["write = true"] if self.write else []
        return f"{{ {', '.join(keys)}, when_stale = {_when_stale(self.when_stale)} }}"


def every_point(rows: Sequence[Row], every: str) -> str:
    """The table in the config for all points of a device, which these rows are."""
    first = rows[0]
    when_stale = _when_stale(first.when_stale)
    return (
        f'{{ at = {first.at}, area = "{first.area}", device = "{first.source.device}", point = "*", '
        f'every = "{every}", when_stale = {when_stale} }}'
    )


def _encoding(how: Encoding) -> str:
    if how.type == "string":
        return f'type = "string", swap = "{how.swap}"'
    return f'type = "{how.type}", swap = "{how.swap}", scale = {how.scale}, offset = {how.offset}'


def _when_stale(how: str | int) -> str:
    return f'"{how}"' if isinstance(how, str) else str(how)
