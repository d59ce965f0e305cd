"""The points of every unit."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import NamedTuple

from gateway.config.plan.names import device_names, keys_of, owners, rows_of
from gateway.config.plan.points import points_of
from gateway.config.plan.reach import is_apart, passing_units, units_without_devices
from gateway.config.plan.settings import Plan
from gateway.config.schema.config import Config
from gateway.images import self_map
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.modbus.codes import Area
from gateway.profiles.guards import Guard, Guards
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, covers


class DevicePoints(NamedTuple):
    """The points of a device. `unit` is its number in the gateway; None if only a listener for its line leads to it."""

    name: str
    unit: int | None
    points: tuple[Point, ...]


def points_of_profiles(config: Config) -> Callable[[str], tuple[Point, ...]]:
    """Make a function that gives the points of a profile, by its name."""

    @cache  # most of the built-in profiles are not in use
    def of_profile(name: str) -> tuple[Point, ...]:
        return with_turns(points_of(config.profile[name].points, config.profile[name]))

    return of_profile


def points_of_units(
    of_devices: Iterable[DevicePoints],
    images: Iterable[ImageSettings],
    mirrors: Iterable[MirrorSettings],
    of_profile: Callable[[str], tuple[Point, ...]],
) -> Iterator[tuple[int, tuple[Point, ...]]]:
    """Find the points of each unit. An image has those of its profile that are in its areas.

    A mirror has those of its device, likewise; what is only written goes through to the device.
    """
    for image in images:
        yield image.unit, points_in(image.areas, of_profile(image.profile.name))
    by_name = {device.name: device for device in of_devices}
    for mirror in mirrors:
        device = by_name.get(mirror.of)
        points = () if device is None or device.unit is None else device.points
        in_mirror = points_in(mirror.areas, points)
        yield mirror.unit, tuple(each for each in points if each.write == "only" or each in in_mirror)
    yield from ((device.unit, device.points) for device in by_name.values() if device.unit is not None)


def own_points(plan: Plan) -> tuple[Point, ...]:
    """Make the points of the gateway itself."""
    names = {
        self_map.LINES.title: [line.line.name for line in plan.lines],
        self_map.SERVERS.title: [server.line.name for server in plan.servers],
        self_map.UPSTREAMS.title: [upstream.upstream.name for upstream in plan.upstreams],
    }
    return self_map.points(names)


def points_of_devices(config: Config, of_profile: Callable[[str], tuple[Point, ...]]) -> Iterator[DevicePoints]:
    """Find the points of each device. On a line that is apart, units are not those of the clients."""
    for line in config.line:
        if line.role == "client" and line.devices is None:
            points = of_profile(line.profile)
            shared = frozenset() if is_apart(line, config) else frozenset(passing_units(config))
            for unit in units_without_devices(line, config):
                yield DevicePoints(f"{line.label}/{unit}", unit if unit in shared else None, points)
    for owner in owners(config):
        for row in rows_of(owner):
            kind = row.profile or owner.profile
            points = of_profile(kind)
            if row.points:
                points = with_turns((*points, *points_of(row.points, config.profile[kind])))
            named = zip(device_names(owner, row), keys_of(owner, row), strict=True)
            yield from (DevicePoints(name, key, points) for name, key in named)


def with_turns(points: tuple[Point, ...]) -> tuple[Point, ...]:
    """Have bits written in a turn where a guarded point has bits of their register: it must be seen as a whole."""
    guards = Guards.of(points)
    if not guards:
        return points
    return tuple(
        replace(each, in_turn=True)
        if each.bits is not None and each.write != "no" and guards.touch(Guard.of(each).place)
        else each
        for each in points
    )


def points_in(areas: Mapping[Area, tuple[Range, ...]], points: Iterable[Point]) -> tuple[Point, ...]:
    """Choose the points whose addresses are all in these areas."""
    return tuple(point for point in points if covers(areas.get(point.area, ()), point.read_span))
