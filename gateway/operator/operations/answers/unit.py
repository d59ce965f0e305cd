"""Units as clients see them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from gateway.devices.device import key_of
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Range
from gateway.profiles.read_rules import ReadRules

#: The kinds of units that are devices.
DEVICES: Final = ("device", "upstream", "heard")


@dataclass(frozen=True, slots=True)
class UnitHead:
    """A unit as clients see it: what answers for it, and what it accepts.

    `unit` is None for a device that they ask by its name, or by a listener for its line or upstream. `kind` is device
    (on a line), upstream (a device behind another server), heard (a device on a line that only listens, where nothing
    can be asked), image, mirror, virtual, custom (made in Python) or gateway. `functions` is None if it
    accepts all. `limits` are the most items by function. `areas` are the first and last address of each range that
    exists, by area; an area that is missing exists in full. Points are read together over gaps of at most `max_gap`
    addresses. Registers in `wide` have four bytes. A response takes at most `longest_wait_ms`; 0 for a unit that the
    gateway answers itself.
    """

    unit: int | None
    name: str
    kind: str
    profile: str
    functions: tuple[int, ...] | None
    limits: Mapping[int, int]
    areas: Mapping[str, tuple[Range, ...]]
    longest_wait_ms: float
    max_gap: int = field(default=0, kw_only=True)
    wide: Mapping[str, tuple[Range, ...]] = field(default_factory=dict, kw_only=True)

    @property
    def is_device(self) -> bool:
        """Whether it is a device, and not an image of any kind."""
        return self.kind in DEVICES

    @property
    def is_asked(self) -> bool:
        """Whether its values are known only when it is asked for them: not those of images."""
        return self.is_device or self.kind == "custom"

    @property
    def key(self) -> int:
        """The number that routers know it by."""
        return key_of(self.name) if self.unit is None else self.unit


@dataclass(frozen=True, slots=True)
class UnitPicture(UnitHead):
    """A unit as clients see it, and its points."""

    points: tuple[Point, ...]

    @property
    def read_rules(self) -> ReadRules:
        """What one read of it may take."""
        areas = {Area(area): ranges for area, ranges in self.areas.items()}
        only_written = tuple(point.span for point in self.points if point.write == "only")
        return ReadRules(self.limits, self.max_gap, areas, only_written)


@dataclass(frozen=True, slots=True)
class Units:
    """All units, by number; those without one come last."""

    units: tuple[UnitHead, ...]


@dataclass(frozen=True, slots=True)
class RequestAnswer:
    """The outcome of a request: the response `pdu` in hexadecimal, None if there is none, and the time that it took.

    `sent` and `received` are the frames on the line, if any. For an exception from the gateway itself, `result` and
    `reason` say why.
    """

    unit: int | None
    pdu: str | None
    elapsed_ms: float
    sent: str = ""
    received: str = ""
    result: str = ""
    reason: str = ""
