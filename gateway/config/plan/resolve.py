"""Turns a config into the settings of every part. The parts do not depend on the config."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

from gateway.config.plan.plan import (
    DEFAULT_LISTENER,
    FleetPlan,
    LinePlan,
    LogSettings,
    Plan,
    UpstreamPlan,
    WebPlan,
)
from gateway.config.plan.publishing import Publishable, publishing
from gateway.config.plan.resolve_lines import line_plan, server_plan, upstream_plan
from gateway.config.plan.resolve_points import own_points, points_of_units
from gateway.config.plan.resolve_profile import profile_of
from gateway.config.schema.fleet import Fleet
from gateway.config.schema.root import Access, Config, Image, Listen, Log
from gateway.config.schema.web import Web
from gateway.config.values.ranges import join_ranges
from gateway.devices.device import DeviceSettings
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings, Poll
from gateway.images.self_image import self_settings
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT, Area
from gateway.profiles.profile import Profile
from gateway.routing.access import DEFAULT_ROWS, NOTHING, READING, WRITING, AccessRow, Right, right_to
from gateway.tls.settings import ClientTls, ServerTls

_RIGHTS: Final = {"read": READING, "write": WRITING}


def resolve(config: Config) -> Plan:
    """The settings that `config` asks for. The config must have passed its checks."""
    profiles = {name: profile_of(name, table) for name, table in config.profile.items()}
    lines = tuple(line_plan(line, profiles, config) for line in config.line if line.role == "client")
    upstreams = tuple(upstream_plan(upstream, config) for upstream in config.upstream)
    owners: tuple[LinePlan | UpstreamPlan, ...] = (*lines, *upstreams)
    devices = {device.name: device for owner in owners for device in owner.devices}
    images = tuple(_image(image, profiles) for image in config.image if image.of is None)
    own = () if config.own is None else (self_settings(config.own.unit, config.own.source),)
    mirrors = tuple(_mirror(image, devices[image.of]) for image in config.image if image.of is not None)
    behind = {device.known_as: device.profile for line in lines for device in line.shared}
    behind |= {device.known_as: device.profile for upstream in upstreams for device in upstream.devices}
    behind |= {each.unit: each.profile for each in (*images, *own, *mirrors)}
    plan = Plan(
        site=config.site,
        listeners=tuple(_listener(listen, config.listen) for listen in config.listen) or (DEFAULT_LISTENER,),
        lines=lines,
        servers=tuple(server_plan(line, behind) for line in config.line if line.role == "server"),
        upstreams=upstreams,
        images=(*images, *own),
        mirrors=mirrors,
        access=tuple(map(_access, config.access)) or DEFAULT_ROWS,
        log=_log(config.log),
        points={unit: points for unit, points in points_of_units(config, images, mirrors) if points},
        control=None if config.control is None else config.control.socket,
        ring=config.trace.ring,
        web=None if config.web is None else _web(config.web),
        fleet=None if config.fleet is None else _fleet(config.site, config.fleet),
    )
    if config.own is not None:
        plan = replace(plan, points={**plan.points, config.own.unit: own_points(plan)})
    if config.mqtt is not None:
        plan = replace(plan, mqtt=publishing(config.site, config.mqtt, publishable(plan)))
    return plan


def publishable(plan: Plan) -> Iterator[Publishable]:
    """Every unit that can be published, by its name."""
    behind = ((one.line.name, one.shared) for one in plan.lines)
    others = ((one.upstream.name, one.devices) for one in plan.upstreams)
    for line, devices in (*behind, *others):
        for device in devices:
            points = plan.points.get(device.known_as, ())
            yield Publishable(device.name, device.known_as, line, device.profile, points)
    own: tuple[ImageSettings | MirrorSettings, ...] = (*plan.images, *plan.mirrors)
    for each in own:
        yield Publishable(each.name, each.unit, "", each.profile, plan.points.get(each.unit, ()))


def _listener(listen: Listen, everyone: Iterable[Listen]) -> ListenSettings:
    bind = listen.bind
    return ListenSettings(
        name=listen.label,
        host=bind.host,
        port=bind.port,
        clients=listen.clients,
        reserve=listen.reserve,
        idle=listen.idle,
        in_flight=listen.in_flight,
        unit0=listen.unit0 if listen.upstream is None else BROADCAST_UNIT,  # there it is a unit of the server
        on_failure=listen.on_failure,
        source=listen.source,
        scheme=bind.scheme,
        ipv6_only=any(bind.takes_ipv4_of(other.bind) for other in everyone),
        line=listen.line or "",
        upstream=listen.upstream or "",
        shares_port=any(bind.has_port_of(other.bind) for other in everyone if other is not listen),
        tls=_server_tls(listen),
    )


def _server_tls(table: Listen | Web) -> ServerTls | None:
    if table.certificate is None or table.key is None:
        return None
    if isinstance(table, Listen):
        return ServerTls(table.certificate, table.key, table.clients_ca, table.crl)
    return ServerTls(table.certificate, table.key)


def _image(image: Image, profiles: dict[str, Profile]) -> ImageSettings:
    return ImageSettings(
        unit=image.unit,
        name=image.label,
        profile=profiles[image.profile],
        areas={area: image.ranges(area) for area in Area if image.ranges(area)},
        initial={
            area: tuple((row.at, row.values) for row in image.initial.rows(area))
            for area in Area
            if image.initial.rows(area)
        },
        persist=image.persist,
        source=image.source,
    )


def _mirror(image: Image, device: DeviceSettings) -> MirrorSettings:
    polls = tuple(
        Poll(area, first, last, row.every) for row in image.read for area in Area for first, last in row.ranges(area)
    )
    areas = {area: join_ranges((poll.first, poll.last) for poll in polls if poll.area is area) for area in Area}
    return MirrorSettings(
        image.unit, image.label, device.name, device.profile, polls, areas, image.stale, source=image.source
    )


def _access(row: Access) -> AccessRow:
    return AccessRow(
        right=_right(row),
        networks=None if row.networks is None else row.addresses,
        listeners=None if row.listen is None else frozenset(row.listen),
        units=None if row.units == "all" else frozenset(row.units),
        role=row.role,
        source=row.source,
        sites=frozenset(row.sites),
    )


def _right(row: Access) -> Right:
    if row.functions is not None:
        return right_to(row.functions)
    return NOTHING.union(*(_RIGHTS[name] for name in row.allow or ()))


def _web(web: Web) -> WebPlan:
    return WebPlan(
        bind=web.bind,
        hosts=web.hosts,
        token=web.token,
        users=web.users,
        tls=_server_tls(web),
        source=web.source,
        proxy=web.proxy or (),
        write=web.write,
        history=web.history,
    )


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
        source=fleet.source,
    )


def _log(log: Log) -> LogSettings:
    return LogSettings(log.level, log.format)
