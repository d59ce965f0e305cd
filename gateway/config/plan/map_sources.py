"""What a virtual unit can read, and what it may not ask for: devices and local images, with their points."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from gateway.config.plan.settings import Plan
from gateway.config.plan.unit_points import DevicePoints
from gateway.config.values.ranges import show_ranges
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
