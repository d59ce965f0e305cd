"""The settings of register images and mirrors."""

from collections.abc import Iterable, Mapping
from typing import Final, Literal

from gateway.config.plan.points import initial_values, ranges_in
from gateway.config.plan.unit_points import points_in
from gateway.config.schema.image import Image
from gateway.config.values.ranges import MOST_ITEMS, join_ranges
from gateway.devices.device import DeviceSettings
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings, Poll
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile

#: The kinds of units whose values come from no device.
OWN_VALUES: Final = ("image", "unit made in Python")
#: All addresses of an area.
EVERY_ADDRESS: Final = ((0, MOST_ITEMS - 1),)


def kind_of(image: Image) -> Literal["image", "mirror", "virtual unit", "unit made in Python"]:
    """Tell what the keys of a table make it."""
    if image.python is not None:
        return "unit made in Python"
    return "mirror" if image.of is not None else "virtual unit" if image.has("map") else "image"


def image_settings(image: Image, profiles: Mapping[str, Profile]) -> ImageSettings:
    """Turn a table without `of` into the settings of a register image, or of a unit made in Python."""
    profile = profiles[image.profile]
    areas = {area: ranges_in(area, image) for area in Area if ranges_in(area, image)}
    if image.python is not None and not areas:
        areas = {area: ranges for area in Area if (ranges := profile.areas.get(area, EVERY_ADDRESS))}
    return ImageSettings(
        unit=image.unit,
        name=image.label,
        profile=profile.guarding(points_in(areas, profile.guards.points)) if profile.guards else profile,
        areas=areas,
        initial={
            area: tuple((row.at, row.values) for row in initial_values(area, image))
            for area in Area
            if initial_values(area, image)
        },
        persist=image.persist,
        python=image.python or "",
        timeout=image.timeout,
        source=image.place,
    )


def mirror_settings(image: Image, device: DeviceSettings, points: Iterable[Point] | None) -> MirrorSettings:
    """Turn a table with `of` into the settings of a mirror of this device; one that is only heard has `points`."""
    polls = tuple(
        Poll(area, first, last, row.every or 0.0)
        for row in image.read
        for area in Area
        for first, last in ranges_in(area, row)
    )
    areas = {area: join_ranges((poll.first, poll.last) for poll in polls if poll.area is area) for area in Area}
    return MirrorSettings(
        image.unit,
        image.label,
        device.name,
        device.profile,
        polls,
        areas,
        image.stale,
        source=image.place,
        together=None if points is None else tuple(point.span for point in points if point.count > 1),
    )
