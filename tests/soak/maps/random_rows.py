"""Random rows of a map over some devices: by range and by point, of all types, areas and orders of words."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from gateway.modbus.codes import Area
from soak.maps.conversion import Encoding
from soak.maps.devices import ITEMS, POINTS, Point
from soak.maps.rows import BITS, Row, Source

_REGISTERS: Final = (Area.HOLDING, Area.INPUT)
_SWAPS: Final = ("none", "words", "bytes", "both")
_TYPES: Final = ("uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64", "bcd16", "bcd32")
_SCALES: Final = ("1", "1", "0.1", "0.5", "10", "-2")
_OFFSETS: Final = ("0", "0", "100", "-0.5")
#: The most tables that are new in a map, and their most devices; the longest range; the largest gap between two rows.
_ROWS, _DEVICES, _LONGEST, _GAP = 12, 5, 12, 2
#: Types in which a row can be written without losing anything.
_EXACT: Final = ("int64", "float64")


@dataclass
class RandomMap:
    """The map of one unit: groups of rows that are one table each, and addresses in each area.

    `bits_at` is where the fresh bits of `devices` are, `ages` where the ages are, `own` are its own holding registers.
    """

    stale: float
    groups: list[tuple[Row, ...]] = field(default_factory=list)
    devices: tuple[str, ...] = ()
    bits_area: Area = Area.HOLDING
    bits_at: int = 0
    ages: dict[int, str] = field(default_factory=dict)
    own: range = range(0)

    @property
    def rows(self) -> Iterator[Row]:
        """All of its rows."""
        for group in self.groups:
            yield from group


class MapMaker:
    """Makes random maps over devices with these names. Images have `holding` registers only, as many as a device."""

    def __init__(self, dice: random.Random, names: Sequence[str], images: Sequence[str]) -> None:
        self._dice = dice
        self._names = (*names, *images)
        self._images = images

    def make(self, kept: Sequence[tuple[Row, ...]] = ()) -> RandomMap:
        """Make a map; it begins with the groups that are `kept`."""
        dice = self._dice
        found = RandomMap(dice.choice((0.8, 1.5, 3.0)), list(kept))
        free = dict.fromkeys(Area, 0) | {group[0].area: group[-1].end for group in kept}
        devices = dice.sample(self._names, dice.randint(1, _DEVICES))
        for _ in range(dice.randint(2, _ROWS)):
            self._add(found, self._group(dice.choice(devices), free), free)
        found.devices = tuple(dict.fromkeys(row.source.device for row in found.rows))
        found.bits_area = dice.choice(tuple(Area))
        found.bits_at = free[found.bits_area]
        free[found.bits_area] += len(found.devices) if found.bits_area in BITS else 1
        for name in dice.sample(found.devices, dice.randint(0, len(found.devices))):
            found.ages[free[Area.HOLDING]] = name
            free[Area.HOLDING] += 1
        found.own = range(free[Area.HOLDING], free[Area.HOLDING] + dice.randint(0, 4))
        return found

    def change(self, found: RandomMap) -> RandomMap:
        """Make another map, which has some rows of this one, or all of them, or none."""
        dice = self._dice
        if dice.random() < 0.3:
            return replace(found, stale=dice.choice((0.8, 1.5, 3.0)))
        return self.make(found.groups[: dice.choice((0, 1, 2, 5))])

    def _add(self, found: RandomMap, group: tuple[Row, ...], free: dict[Area, int]) -> None:
        found.groups.append(group)
        free[group[0].area] = group[-1].end + self._dice.choice((0, 0, 0, self._dice.randint(0, _GAP)))

    def _group(self, device: str, free: dict[Area, int]) -> tuple[Row, ...]:
        dice = self._dice
        if device in self._images:
            return (self._range(device, Area.HOLDING, free),)
        if dice.random() < 0.5:
            return (self._range(device, dice.choice(tuple(Area)), free),)
        if dice.random() < 0.1:
            return tuple(self._every_point(device, free))
        points = [point for point in POINTS.values() if dice.random() < 0.6 or point.written_at >= 0]
        return (self._point(device, dice.choice(points), free),)

    def _range(self, device: str, area: Area, free: dict[Area, int]) -> Row:
        dice = self._dice
        first = dice.randrange(ITEMS[area])
        source = Source(device, area, first, dice.randint(1, min(_LONGEST, ITEMS[area] - first)))
        here = dice.choice(BITS if area in BITS else _REGISTERS)
        is_writable = area == here and area in (Area.HOLDING, Area.COILS)
        if is_writable and dice.random() < 0.6:
            return Row(here, free[here], source, write=True, when_stale=self._when_stale(here))
        swap = dice.choice(_SWAPS) if area in _REGISTERS and source.count % 2 == 0 else "none"
        return Row(here, free[here], source, swap=swap, when_stale=self._when_stale(here))

    def _point(self, device: str, point: Point, free: dict[Area, int]) -> Row:
        dice, here = self._dice, self._dice.choice(BITS if point.encoding is None else _REGISTERS)
        if point.name == "flag" and dice.random() < 0.5:
            here = dice.choice(BITS)
        is_writable = point.written_at >= 0 and here == point.area
        write = is_writable and dice.random() < 0.7
        target, is_plain = (None, True) if here in BITS else self._target(point, exact=write)
        source = Source(device, point.area, point.first, point.count, point)
        return Row(here, free[here], source, target, is_plain=is_plain, write=write, when_stale=self._when_stale(here))

    def _every_point(self, device: str, free: dict[Area, int]) -> Iterator[Row]:
        """A row for each point of registers, or of bits."""
        here = self._dice.choice(tuple(Area))
        order = (Area.COILS, Area.DISCRETE) if here in BITS else (Area.HOLDING, Area.INPUT)
        points = [point for point in POINTS.values() if point.area in order]
        at, when_stale = free[here], self._when_stale(here)
        for point in sorted(points, key=lambda each: (order.index(each.area), each.first)):
            source = Source(device, point.area, point.first, point.count, point)
            row = Row(here, at, source, _as_number(point), is_plain=True, when_stale=when_stale)
            yield row
            at = row.end

    def _target(self, point: Point, *, exact: bool) -> tuple[Encoding | None, bool]:
        dice, encoding = self._dice, point.encoding
        if encoding is None or dice.random() < 0.3:
            return _as_number(point), True
        if encoding.type == "string":
            return Encoding("string", dice.choice(_SWAPS), text=encoding.text), False
        if exact:
            data_type = dice.choice(_EXACT)
            scale = dice.choice(("0.1", "0.5")) if data_type == "int64" else dice.choice(_SCALES)
            if (data_type, point.name, scale) == ("int64", "set-point", "0.5") or point.name == "set-turned":
                scale = "0.1"
            return Encoding(data_type, dice.choice(_SWAPS), scale, "0"), False
        return Encoding(dice.choice(_TYPES), dice.choice(_SWAPS), dice.choice(_SCALES), dice.choice(_OFFSETS)), False

    def _when_stale(self, area: Area) -> str | int:
        return self._dice.choice(("exception", "hold", self._dice.randrange(2 if area in BITS else 0x10000)))  # type: ignore[return-value]


def _as_number(point: Point) -> Encoding | None:
    """How a point is shown whose row says nothing: bits as a number, anything else as it is."""
    return Encoding("uint16") if point.encoding is not None and point.encoding.bits is not None else None
