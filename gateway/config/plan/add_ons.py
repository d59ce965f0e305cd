"""What `[web]`, `[mqtt]` and `[fleet]` ask for: pages, the broker and what is published, the servers of NATS."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Final, NamedTuple

from gateway.config.plan.settings import FleetPlan, LeasePlan, MqttPlan, Plan, WebPlan
from gateway.config.schema.add_ons import Fleet, Mqtt, Publish, Web
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings
from gateway.images.virtual.settings import VirtualSettings
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.tls.settings import ClientTls, ServerTls

#: Before a pattern of `points` in a row of `publish`: these are left out.
EXCLUDES: Final = "!"
#: Bytes of the file for the values of a device in one `keep_every`, and further ones for each value: the most that was
#: measured. Compressed text of a number is shorter the fewer digits change; that of a float64 is the longest.
_ROW: Final = 220
_VALUE: Final = 12
_FLOAT64: Final = 20


class Publishable(NamedTuple):
    """A unit that has points: a device, or an image of any kind; see PublishedDevice."""

    name: str
    unit: int
    profile: Profile
    points: tuple[Point, ...]
    on_the_wire: int | None = None


def add_mqtt(plan: Plan, config: Config) -> Plan:
    """Add what is published to a plan, if the config asks for it. All other units and their points are in the plan."""
    if config.mqtt is None:
        return plan
    rows = config.mqtt.publish
    with_points = (
        device for monitor in plan.monitors for device in monitor.devices if plan.points.get(device.known_as)
    )
    heard = tuple(each.name for each in with_points if any(names_device(row, each.name) for row in rows))
    return replace(plan, mqtt=_mqtt(config.site, config.mqtt, publishable(plan), heard))


def publishable(plan: Plan) -> Iterator[Publishable]:
    """Find every unit that can be published."""
    behind = (*(one.shared for one in plan.lines), *(one.devices for one in plan.upstreams))
    for device in (device for devices in behind for device in devices):
        points = plan.points.get(device.known_as, ())
        on_the_wire = device.unit if device.client_unit is None else None
        yield Publishable(device.name, device.known_as, device.profile, points, on_the_wire)
    own: tuple[ImageSettings | MirrorSettings | VirtualSettings, ...] = (*plan.images, *plan.mirrors, *plan.virtual)
    for each in own:
        yield Publishable(each.name, each.unit, each.profile, plan.points.get(each.unit, ()))


def names_device(row: Publish, name: str) -> bool:
    """Tell whether a row means the device with this name."""
    return fnmatchcase(name, row.device)


def names_point(row: Publish, name: str) -> bool:
    """Tell whether a row means the point with this name, of a device that it means. What it excludes it never means."""
    excluded = [pattern[1:] for pattern in row.points if pattern.startswith(EXCLUDES)]
    named = [pattern for pattern in row.points if not pattern.startswith(EXCLUDES)]
    is_named = _matches(name, named) if named else bool(excluded)
    return is_named and not _matches(name, excluded)


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _mqtt(site: str, mqtt: Mqtt, known: Iterable[Publishable], heard: tuple[str, ...]) -> MqttPlan:
    return MqttPlan(
        site=site,
        broker=mqtt.broker,
        devices=tuple(device for each in known if (device := _published(each, mqtt)).points),
        user=mqtt.user,
        password=mqtt.password,
        tls=_tls(mqtt),
        write=mqtt.write,
        prefix=mqtt.prefix,
        keep=mqtt.keep,
        keep_every=mqtt.keep_every,
        home_assistant=mqtt.home_assistant,
        sparkplug=mqtt.sparkplug,
        source=mqtt.place,
        heard=heard,
    )


def _published(unit: Publishable, mqtt: Mqtt) -> PublishedDevice:
    rows = [row for row in mqtt.publish if names_device(row, unit.name)]
    points = tuple(_points(unit.points, rows, may_write=mqtt.write))
    profile = unit.profile
    title = profile.title or profile.name
    return PublishedDevice(
        unit.name, unit.unit, title, points, profile.limits, profile.functions, unit.on_the_wire, profile.maker
    )


def _points(points: Iterable[Point], rows: Iterable[Publish], *, may_write: bool) -> Iterator[PublishedPoint]:
    rows = tuple(rows)
    for point in points:
        row = next((row for row in rows if names_point(row, point.name)), None)
        is_writable = may_write and point.write != "no"
        if row is not None and (is_writable or point.write != "only"):
            yield PublishedPoint(point, row.every, is_writable, row.on_change, row.at_least)


def _tls(mqtt: Mqtt) -> ClientTls | None:
    if not mqtt.broker.is_encrypted:
        return None
    return ClientTls(mqtt.certificate, mqtt.key, mqtt.ca, mqtt.server_name or mqtt.broker.address.host)


class Outage(NamedTuple):
    """`keep` is enough for so many `seconds`, at this many `values_per_s` at the most."""

    seconds: float
    values_per_s: float


def longest_outage(mqtt: MqttPlan) -> Outage | None:
    """Compute what fits into `keep` at least; None if nothing is kept."""
    points = [point for device in mqtt.devices for point in _read(device)]
    if not mqtt.keep or not points:
        return None
    rows = sum(_rows_per_s(device, mqtt.keep_every) for device in mqtt.devices)
    values = sum(_bytes(point) / point.every for point in points)
    return Outage(mqtt.keep / (_ROW * rows + values), sum(1 / point.every for point in points))


def _rows_per_s(device: PublishedDevice, keep_every: float) -> float:
    reads = sum(1 / every for every in {point.every for point in _read(device)})
    return min(1 / keep_every, reads)


def _bytes(point: PublishedPoint) -> int:
    if point.point.type == "string":
        return _VALUE + point.point.width * point.point.count
    return _FLOAT64 if point.point.type == "float64" else _VALUE


def _read(device: PublishedDevice) -> list[PublishedPoint]:
    return [point for point in device.points if point.is_readable]


def add_web(plan: Plan, config: Config) -> Plan:
    """Add the settings of the web page and its API to a plan, if the config asks for them."""
    return plan if config.web is None else replace(plan, web=_web(config.web))


def _web(web: Web) -> WebPlan:
    return WebPlan(
        bind=web.bind,
        hosts=web.hosts,
        token=web.token,
        users=web.users,
        tls=None if web.certificate is None or web.key is None else ServerTls(web.certificate, web.key),
        source=web.place,
        proxy=web.proxy or (),
        write=web.write,
        history=web.history,
        values=web.values,
    )


def add_fleet(plan: Plan, config: Config) -> Plan:
    """Add the way to other sites to a plan, if the config asks for it."""
    return plan if config.fleet is None else replace(plan, fleet=_fleet(config.site, config.fleet))


def lease_of(line: Line, config: Config) -> LeasePlan | None:
    """Describe the lease of a line; None for a line without one."""
    fleet = config.fleet
    if line.lease is None or fleet is None:
        return None
    return LeasePlan(line.lease, config.site, fleet.lease, fleet.fallback)


def _fleet(site: str, fleet: Fleet) -> FleetPlan:
    is_encrypted = any(server.scheme == "tls" for server in fleet.servers)
    return FleetPlan(
        site=site,
        servers=fleet.servers,
        user=fleet.user,
        password=fleet.password,
        credentials=fleet.credentials,
        tls=ClientTls(fleet.certificate, fleet.key, fleet.ca, "") if is_encrypted else None,
        lease=fleet.lease,
        fallback=fleet.fallback,
        source=fleet.place,
    )
