"""What a row of a virtual unit can read, and where it stands: its addresses, or a point of the profile."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from gateway.config.plan.settings import Plan
from gateway.config.plan.unit_points import DevicePoints
from gateway.config.problem import did_you_mean
from gateway.config.schema.image import Image, Mapped
from gateway.config.values.ranges import MOST_ITEMS, show_ranges
from gateway.images.polls import polling_function
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range, covers


@dataclass(frozen=True, slots=True)
class MapSource:
    """A device or a local image that rows of virtual units may name.

    `areas` are the addresses that exist; an area that is not named has all.
    """

    name: str
    profile: Profile
    areas: Mapping[Area, tuple[Range, ...]]
    points: Mapping[str, Point]


def map_sources(plan: Plan, of_devices: Iterable[DevicePoints]) -> dict[str, MapSource]:
    """Find all that rows may name, by name. `plan` has no virtual units yet."""
    points = {device.name: device.points for device in of_devices}
    sources = {
        device.name: MapSource(device.name, device.profile, device.profile.areas, _by_name(points[device.name]))
        for owner in plan.owners
        for device in owner.devices
    }
    for image in plan.images:
        areas = {area: image.areas.get(area, ()) for area in Area}
        of_image = _by_name(plan.points.get(image.unit, ()))
        sources[image.name] = MapSource(image.name, image.profile, areas, of_image)
    return sources


def cannot_be_polled(
    name: str, functions: Iterable[int] | None, exist: tuple[Range, ...] | None, span: Span
) -> Iterator[tuple[str, str]]:
    """Say why a device with these functions (None: all) and addresses has no answer to a poll, and what it has."""
    function = polling_function(span.area)
    if functions is not None and function not in functions:
        yield f"{name} has no function {function:d}, which reads {span.area}", ""
    if not covers(exist, span):
        what = f"{name} does not have all of {span.area} {span.start}-{span.end - 1}"
        yield what, f"its {span.area}: {show_ranges(exist or ())}"


def _by_name(points: Iterable[Point]) -> dict[str, Point]:
    return {point.name: point for point in points}


class WrongRow(Exception):  # noqa: N818 - it is a row that is wrong, not the program
    """What is wrong with the value of a key of a row, and what to write instead."""

    def __init__(self, key: str, what: str, remedy: str = "") -> None:
        super().__init__(what)
        self.key = key
        self.remedy = remedy


class RowPlace(NamedTuple):
    """Where a row begins, and the point of the profile that it is, if `at` names one."""

    area: Area
    start: int
    point: Point | None = None

    def check_size(self, count: int, key: str) -> None:
        """Check that so many registers or coils, which are no value of a point, are as many as the point has here."""
        if self.point is not None and self.point.count != count:
            what = f"takes {count}, and point {self.point.name} has {self.point.count}"
            raise WrongRow(key, what, "map as many as it has, or write an address for at")


@dataclass(frozen=True, slots=True)
class MapTarget:
    """The unit whose rows are planned: its table, its profile, and the points that rows may name as their place."""

    image: Image
    profile: Profile
    points: Mapping[str, Point]

    def place_of(self, row: Mapped) -> RowPlace:
        """Find where a row begins."""
        if isinstance(row.at, int):
            return RowPlace(Area(row.area), row.at)
        point = self.points.get(row.at)
        if point is not None and point.bits is not None and point.type != "string":
            what = f"{point.name} is a part of register {point.address}, and a row takes whole registers"
            raise WrongRow("at", what, "map that register by its address, or make it one of the unit's own")
        if point is not None:
            return RowPlace(point.area, point.address, point)
        name = self.profile.name
        if not self.points:
            raise WrongRow("at", f"profile {name} has no points", "write an address, such as at = 0")
        remedy = did_you_mean(row.at, self.points) or f"modbus-gateway profile {name} lists its points"
        raise WrongRow("at", f'profile {name} has no point "{row.at}"', remedy)

    def span(self, area: Area, start: int, count: int) -> Span:
        """Make the addresses of a row, or of a part of it."""
        span = Span(area, start, count)
        if span.end > MOST_ITEMS:
            raise WrongRow("at", f"ends at {span.end - 1}, and the last address is {MOST_ITEMS - 1}")
        profile, function = self.profile, polling_function(area)
        if not profile.knows(function):
            what = f"profile {profile.name} has no function {function:d}, which reads {area}"
            raise WrongRow("at", what, "choose another area")
        exist = profile.areas.get(area)
        if not covers(exist, span):
            what = f"profile {profile.name} has no {area} {span.addresses}"
            raise WrongRow("at", what, f"its {area}: {show_ranges(exist or ())}")
        return span

    def initial_int16(self, area: Area, address: int) -> int | None:
        """Find the int16 that a register of the unit's own has at first; None if the config says none."""
        rows = getattr(self.image.initial, area)
        found = [row.values[address - row.at] for row in rows if 0 <= address - row.at < len(row.values)]
        return None if not found else found[0] - 0x10000 if found[0] > 0x7FFF else found[0]
