"""The points of every unit."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache

from gateway.config.plan.names import device_names, keys_of, owners, rows_of
from gateway.config.plan.points import points_of
from gateway.config.plan.reach import is_apart, passing_units
from gateway.config.plan.settings import Plan
from gateway.config.schema.config import Config
from gateway.images import self_map
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, covers


def points_of_units(
    config: Config, images: Iterable[ImageSettings], mirrors: Iterable[MirrorSettings]
) -> Iterator[tuple[int, tuple[Point, ...]]]:
    """Find the points of each unit. An image has those of its profile that are in its areas.

    A mirror has those of its device, likewise; what is only written goes through to the device.
    """

    @cache  # most of the built-in profiles are not in use
    def of_profile(name: str) -> tuple[Point, ...]:
        return points_of(config.profile[name].points, config.profile[name])

    for image in images:
        yield image.unit, _points_in(image.areas, of_profile(image.profile.name))
    of_devices = {name: (unit, points) for name, unit, points in _device_points(config, of_profile)}
    for mirror in mirrors:
        _, points = of_devices.get(mirror.of, (0, ()))
        in_mirror = _points_in(mirror.areas, points)
        yield mirror.unit, tuple(each for each in points if each.write == "only" or each in in_mirror)
    yield from of_devices.values()


def own_points(plan: Plan) -> tuple[Point, ...]:
    """Make the points of the gateway itself."""
    names = {
        self_map.LINES.title: [line.line.name for line in plan.lines],
        self_map.SERVERS.title: [server.line.name for server in plan.servers],
        self_map.UPSTREAMS.title: [upstream.upstream.name for upstream in plan.upstreams],
    }
    return self_map.points(names)


def _device_points(
    config: Config, of_profile: Callable[[str], tuple[Point, ...]]
) -> Iterator[tuple[str, int, tuple[Point, ...]]]:
    """Name, key and points of each device. On a line that is apart units are not those of the clients."""
    for line in config.line:
        if line.role == "client" and line.devices is None and not is_apart(line, config):
            points = of_profile(line.profile)
            yield from ((f"{line.label}/{unit}", unit, points) for unit in passing_units(config))
    for owner in owners(config):
        for row in rows_of(owner):
            kind = row.profile or owner.profile
            points = (*of_profile(kind), *points_of(row.points, config.profile[kind]))
            named = zip(device_names(owner, row), keys_of(owner, row), strict=True)
            yield from ((name, key, points) for name, key in named)


def _points_in(areas: Mapping[Area, tuple[Range, ...]], points: Iterable[Point]) -> tuple[Point, ...]:
    return tuple(point for point in points if covers(areas.get(point.area, ()), point.read_span))
