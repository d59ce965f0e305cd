"""What is published of a device."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from gateway.profiles.point import Point


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

    `unit` is the number that clients use for it, or what stands in its place; then it is `on_the_wire` there. `profile`
    is the title of its profile, or its name, and `maker` its maker, if known.
    It has these `functions` (all if None); `limits` is the most items for a function.
    """

    name: str
    unit: int
    profile: str
    points: tuple[PublishedPoint, ...]
    limits: Mapping[int, int] = field(default_factory=dict)
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
