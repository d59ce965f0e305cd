"""The settings of virtual units."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property

from gateway.config.plan.images import image_settings
from gateway.config.plan.map_place import MapTarget, map_sources
from gateway.config.plan.map_rows import PlannedRow, planned_rows
from gateway.config.plan.settings import Plan
from gateway.config.plan.unit_points import DevicePoints
from gateway.config.plan.virtual_points import points_of_profile, points_of_rows
from gateway.config.schema.image import Image
from gateway.config.values.ranges import join_ranges
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge, VirtualSettings
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile


class Maps:
    """The virtual units of a config, and what their rows may name.

    `plan` has all parts but virtual units and add-ons, and `of_devices` are the points of its devices.
    """

    def __init__(self, plan: Plan, of_devices: Iterable[DevicePoints], targets: tuple[MapTarget, ...]) -> None:
        self.plan = plan
        self.targets = targets
        self.sources = map_sources(plan, of_devices) if targets else {}

    @cached_property
    def rows(self) -> tuple[tuple[PlannedRow, ...], ...]:
        """The planned rows of each of the `targets`."""
        return tuple(tuple(planned_rows(target, self.sources)) for target in self.targets)

    def added_to(self, plan: Plan) -> Plan:
        """Add the virtual units, whose rows have passed their checks, and their points."""
        units, points = [], {}
        for target, rows in zip(self.targets, self.rows, strict=True):
            unit = _settings(target, rows)
            own = points_of_profile(unit, target.points.values())
            profile = unit.profile.guarding(own)
            units.append(replace(unit, profile=profile, own=replace(unit.own, profile=profile)))
            points[unit.unit] = own or points_of_rows(unit, self.sources)
        return replace(
            plan, virtual=tuple(units), points={**plan.points, **{key: each for key, each in points.items() if each}}
        )


def map_target(
    image: Image, profiles: Mapping[str, Profile], of_profile: Callable[[str], tuple[Point, ...]]
) -> MapTarget:
    """Make the unit whose rows are planned."""
    return MapTarget(image, profiles[image.profile], {point.name: point for point in of_profile(image.profile)})


def _settings(target: MapTarget, rows: Iterable[PlannedRow]) -> VirtualSettings:
    image = target.image
    parts = [part for row in rows for part in row.parts]
    own = image_settings(image, {image.profile: target.profile})
    ranges = {area: list(own.areas.get(area, ())) for area in Area}
    for part in parts:
        ranges[part.place.area].append((part.place.start, part.place.end - 1))
    return VirtualSettings(
        unit=image.unit,
        name=image.label,
        profile=target.profile,
        areas={area: join_ranges(found) for area, found in ranges.items() if found},
        own=own,
        values=tuple(part for part in parts if isinstance(part, MappedValue)),
        fresh=tuple(part for part in parts if isinstance(part, FreshBits)),
        ages=tuple(part for part in parts if isinstance(part, SourceAge)),
        stale=image.stale,
        source=image.place,
    )
