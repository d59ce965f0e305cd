"""What is published of a device, and the reads that this takes."""

from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from gateway.profiles.batches import Batch, batches
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.read_rules import NO_RULES, ReadRules


@dataclass(frozen=True, slots=True)
class PublishedPoint:
    """A point that is published and read every `every` seconds. `is_writable`: from the broker too.

    A new value is published when it differs by `on_change` from the last one that was, or at all if that is None; and
    the same value again after `at_least` seconds. A point that can only be written is never read.
    """

    point: Point
    every: float
    is_writable: bool = False
    on_change: float | None = None
    at_least: float | None = None

    @property
    def name(self) -> str:
        """The point's name, unique in its device."""
        return self.point.name

    @property
    def is_readable(self) -> bool:
        """Whether it has values at all."""
        return self.point.write != "only"


@dataclass(frozen=True, slots=True)
class PublishedDevice:
    """A device with the points that are published, in the order of its configuration.

    `unit` is the number that clients use for it, or what stands in its place; then it is `on_the_wire` there. `line` is
    the name of its line or upstream, `profile` the title of its profile, or its name, and `maker` its maker, if known.
    It has these `functions` (all if None); `rules` say what one read may take.
    """

    name: str
    unit: int
    line: str
    profile: str
    points: tuple[PublishedPoint, ...]
    rules: ReadRules = NO_RULES
    functions: frozenset[int] | None = None
    on_the_wire: int | None = None
    maker: str = ""

    @property
    def told_unit(self) -> int:
        """The unit that logs and the trace show."""
        return self.unit if self.on_the_wire is None else self.on_the_wire

    def point(self, name: str) -> PublishedPoint | None:
        """Find its point with this name; None if there is none."""
        return next((point for point in self.points if point.name == name), None)


class TimedBatch(NamedTuple):
    """Points that one request reads every `every` seconds."""

    every: float
    batch: Batch


def timed_batches(device: PublishedDevice, holes: Holes) -> list[TimedBatch]:
    """Make the reads of a device's points: as few as it allows; `holes` are those that it has refused."""
    readable = sorted((point for point in device.points if point.is_readable), key=lambda each: each.every)
    return [
        TimedBatch(every, batch)
        for every, points in groupby(readable, key=lambda each: each.every)
        for batch in batches((each.point for each in points), device.rules, holes)
    ]
