"""Turns a config into the settings of every part. The parts do not depend on the config."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from gateway.config.address import Address
from gateway.config.character_format import DEFAULT_FORMATS
from gateway.config.fleet import Site
from gateway.config.plan import (
    DEFAULT_LISTENER,
    NETWORK_LATENCY,
    SHARED_ARRIVES_WITHIN,
    FleetPlan,
    LeasePlan,
    LinePlan,
    LogSettings,
    Plan,
    ServerPlan,
    UpstreamPlan,
    WebPlan,
)
from gateway.config.points import points_of
from gateway.config.publishing import Publishable, publishing
from gateway.config.ranges import join_ranges
from gateway.config.schema import Access, Config, Device, Image, Line, Listen, Log, Upstream
from gateway.config.schema_fleet import Fleet
from gateway.config.schema_profile import ProfileTable
from gateway.config.schema_web import Web
from gateway.devices.device import DeviceSettings
from gateway.images import self_map
from gateway.images.image import ImageSettings
from gateway.images.polls import MirrorSettings, Poll
from gateway.images.self_image import self_settings
from gateway.lines.settings import LineSettings
from gateway.listeners.serial_session import ServerSettings
from gateway.listeners.session import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT, Area, FunctionCode
from gateway.ports.port import PortSettings, SerialSettings, SiteSettings, TcpSettings
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range, covers
from gateway.routing.access import DEFAULT_ROWS, NOTHING, READING, WRITING, Right, Row, right_to
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import LineTiming
from gateway.timing.table import Point as TimingPoint
from gateway.timing.table import TimingTable
from gateway.tls.settings import ClientTls, ServerTls
from gateway.upstreams.upstream import UpstreamSettings

#: The silence that ends an RTU frame, in characters (S 2.5.1.1), and the shortest turnaround delay (S 2.4.1).
_IDLE_CHARACTERS: Final = 3.5
_SHORTEST_TURNAROUND: Final = 0.1
#: Anything but a read at address 0 is a broadcast.
ASKED_AT_ZERO: Final = frozenset({FunctionCode.READ_HOLDING_REGISTERS})

_RIGHTS: Final = {"read": READING, "write": WRITING}


def resolve(config: Config) -> Plan:
    """The settings that `config` asks for. The config must have passed its checks."""
    profiles = {name: profile_of(name, table) for name, table in config.profile.items()}
    lines = tuple(_line(line, profiles, config) for line in config.line if line.role == "client")
    upstreams = tuple(_upstream(upstream) for upstream in config.upstream)
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
        servers=tuple(_server_line(line, behind) for line in config.line if line.role == "server"),
        upstreams=upstreams,
        images=(*images, *own),
        mirrors=mirrors,
        access=tuple(map(_access, config.access)) or DEFAULT_ROWS,
        log=_log(config.log),
        points={unit: points for unit, points in _points(config, images, mirrors) if points},
        control=None if config.control is None else config.control.socket,
        ring=config.trace.ring,
        web=None if config.web is None else _web(config.web),
        fleet=None if config.fleet is None else _fleet(config.site, config.fleet),
    )
    if config.own is not None:
        plan = replace(plan, points={**plan.points, config.own.unit: _own_points(plan)})
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


def passing_units(config: Config) -> list[int]:
    """The units of a pass-through line: all without another destination, and those that mirrors poll."""
    elsewhere = {image.unit for image in config.image if image.of is None}
    elsewhere |= {unit for upstream in config.upstream for row in upstream.units for unit in row.known_as}
    elsewhere |= set() if config.own is None else {config.own.unit}
    return [unit for unit in range(FIRST_UNIT, LAST_UNIT + 1) if unit not in elsewhere]


def profile_of(name: str, table: ProfileTable) -> Profile:
    """The profile that a table describes."""
    areas = {area: ranges for area in Area if (ranges := getattr(table, area)) is not None}
    points: dict[int, list[TimingPoint]] = {}
    for row in table.timing:
        points.setdefault(row.fc, []).append(TimingPoint(row.items, row.time))
    return Profile(
        name=name,
        title=table.title,
        functions=None if table.functions is None else frozenset(table.functions),
        limits=table.limits,
        areas=areas,
        idle_chars=table.idle_chars,
        timing=TimingTable.of(points),
        margin=table.margin,
        timeout=table.timeout,
        quirks=frozenset(table.quirks),
    )


def line_timing(line: Line) -> LineTiming:
    """The timing of `line`: mode, rate and character format."""
    return LineTiming(line.spoken, line.baud, line.format or DEFAULT_FORMATS[line.spoken])


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
        unit0=listen.unit0,
        on_failure=listen.on_failure,
        source=listen.source,
        scheme=bind.scheme,
        ipv6_only=any(bind.takes_ipv4_of(other.bind) for other in everyone),
        line=listen.line or "",
        shares_port=any(bind.has_port_of(other.bind) for other in everyone if other is not listen),
        tls=_server_tls(listen),
    )


def _server_tls(table: Listen | Web) -> ServerTls | None:
    if table.certificate is None or table.key is None:
        return None
    if isinstance(table, Listen):
        return ServerTls(table.certificate, table.key, table.clients_ca, table.crl)
    return ServerTls(table.certificate, table.key)


def _client_tls(upstream: Upstream, address: Address) -> ClientTls | None:
    if upstream.certificate is None or upstream.key is None or upstream.ca is None:
        return None
    return ClientTls(upstream.certificate, upstream.key, upstream.ca, upstream.server_name or address.host)


def _line(line: Line, profiles: dict[str, Profile], config: Config) -> LinePlan:
    timing = line_timing(line)
    passing = passing_units(config)
    own = _own_units(line, config, passing)
    devices = tuple(_devices(line, profiles, sorted({*passing, *own})))
    settings, lease = _line_settings(line, timing, devices), _lease(line, config)
    return LinePlan(_port(line, timing), settings, devices, line.devices is None, own, lease)


def _lease(line: Line, config: Config) -> LeasePlan | None:
    fleet = config.fleet
    return (
        None if line.lease is None or fleet is None else LeasePlan(line.lease, config.site, fleet.lease, fleet.fallback)
    )


def _own_units(line: Line, config: Config, passing: list[int]) -> frozenset[int]:
    """The units of a line without devices that only the listeners for it lead to."""
    if line.devices is not None or not config.listeners_for(line):
        return frozenset()
    every_unit = frozenset(range(FIRST_UNIT, LAST_UNIT + 1))
    return every_unit if config.is_apart(line) else every_unit.difference(passing)


def _port(line: Line, timing: LineTiming) -> PortSettings:
    if isinstance(line.port, Address):
        server = _server(line.port, NETWORK_LATENCY if line.latency is None else line.latency)
        return server if line.lease is None else replace(server, arrives_within=SHARED_ARRIVES_WITHIN)
    return SerialSettings(line.port, line.baud, timing.format, line.rs485, line.latency)


def _server(address: Address, latency: float) -> TcpSettings:
    return TcpSettings(str(address), address.host, address.port, latency)


def _line_settings(line: Line, timing: LineTiming, devices: tuple[DeviceSettings, ...]) -> LineSettings:
    return LineSettings(
        name=line.label,
        timing=timing,
        idle_chars=_idle_characters(device.profile for device in devices),
        gap=line.gap,
        turnaround=_turnaround(devices) if line.turnaround is None else line.turnaround,
        late_window=line.late_window,
        retries=line.retries,
        retry_within=line.retry_within,
        rest=line.rest,
        echo=line.echo,
        wire=line.wire,
        coalesce=line.coalesce,
        queue=line.queue,
        max_wait=line.max_wait,
        broadcast=line.broadcast,
        source=line.source,
    )


def _server_line(line: Line, profiles: Mapping[int, Profile]) -> ServerPlan:
    timing = line_timing(line)
    serves = frozenset(line.serves or ())
    settings = ServerSettings(
        name=line.label,
        timing=timing,
        serves=serves,
        idle_chars=_idle_characters(profile for unit, profile in profiles.items() if unit in serves),
        gap=line.gap,
        echo=line.echo,
        wire=line.wire,
        on_failure=line.on_failure,
        answer_within=line.answer_within,
        source=line.source,
    )
    return ServerPlan(_port(line, timing), settings, line.broadcast_to)


def _idle_characters(profiles: Iterable[Profile]) -> float:
    """The silence that ends a frame for all of them."""
    return max([_IDLE_CHARACTERS, *(profile.idle_chars for profile in profiles)])


def _turnaround(devices: Iterable[DeviceSettings]) -> float:
    """Time for the slowest device to act on a broadcast."""
    times = (device.answer_time.margin * device.answer_time.table.slowest for device in devices)
    return max([_SHORTEST_TURNAROUND, *times])


def _devices(line: Line, profiles: dict[str, Profile], passing: list[int]) -> Iterator[DeviceSettings]:
    if line.devices is None:
        row = Device.model_validate({"unit": passing}).placed(line.path, line.source)
        return _of_row(line, row, profiles)
    return (one for row in line.devices for one in _of_row(line, row, profiles))


def _of_row(line: Line, row: Device, profiles: dict[str, Profile]) -> Iterator[DeviceSettings]:
    profile = profiles[row.profile or line.profile]
    if BROADCAST_UNIT in row.units:
        profile = replace(profile, functions=ASKED_AT_ZERO)
    answer_time = _answer_time(line, row, profile)
    for unit, known_as, name in zip(row.units, row.client_units, line.device_names(row), strict=True):
        yield DeviceSettings(
            name=name,
            unit=unit,
            known_as=known_as,
            profile=profile,
            answer_time=answer_time,
            priority=row.priority,
            source=row.source,
        )


def _answer_time(line: Line, row: Device, profile: Profile) -> AnswerTime:
    """A device's own time-out has priority; the line's applies only without a timing table and a named profile."""
    if row.timeout is not None:
        return AnswerTime(profile.timing, profile.margin, row.timeout, fixed=True)
    of_line = line.timeout if row.profile is None else None
    return AnswerTime(profile.timing, profile.margin, of_line or profile.timeout)


def _upstream(upstream: Upstream) -> UpstreamPlan:
    settings = UpstreamSettings(
        name=upstream.label, timeout=upstream.timeout, in_flight=upstream.in_flight, source=upstream.source
    )
    return UpstreamPlan(_other_server(upstream), settings, tuple(_behind(upstream)))


def _other_server(upstream: Upstream) -> TcpSettings | SiteSettings:
    if isinstance(upstream.to, Site):
        return SiteSettings(str(upstream.to), upstream.to.name)
    return replace(_server(upstream.to, latency=0.0), tls=_client_tls(upstream, upstream.to))


def _behind(upstream: Upstream) -> Iterator[DeviceSettings]:
    """The units behind another server, without a profile: the server checks requests itself."""
    answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=upstream.timeout, fixed=True)
    for row in upstream.units:
        for unit, known_as, name in zip(row.units, row.known_as, upstream.unit_names(row), strict=True):
            yield DeviceSettings(name, unit, known_as, Profile("upstream"), answer_time, source=row.source)


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


def _own_points(plan: Plan) -> tuple[Point, ...]:
    """What the gateway tells of itself."""
    names = {
        self_map.LINES.title: [line.line.name for line in plan.lines],
        self_map.SERVERS.title: [server.line.name for server in plan.servers],
        self_map.UPSTREAMS.title: [upstream.upstream.name for upstream in plan.upstreams],
    }
    return self_map.points(names)


def _points(
    config: Config, images: Iterable[ImageSettings], mirrors: Iterable[MirrorSettings]
) -> Iterator[tuple[int, tuple[Point, ...]]]:
    """The points of each unit. An image has those of its profile that are in its areas.

    So has a mirror of its device; what is only written goes through to that.
    """
    of_profiles = {name: points_of(table.points) for name, table in config.profile.items()}
    for image in images:
        yield image.unit, _points_in(image.areas, of_profiles[image.profile.name])
    of_devices = {name: (unit, points) for name, unit, points in _device_points(config, of_profiles)}
    for mirror in mirrors:
        _, points = of_devices.get(mirror.of, (0, ()))
        in_mirror = _points_in(mirror.areas, points)
        yield mirror.unit, tuple(each for each in points if each.write == "only" or each in in_mirror)
    yield from of_devices.values()


def _device_points(
    config: Config, of_profiles: Mapping[str, tuple[Point, ...]]
) -> Iterator[tuple[str, int, tuple[Point, ...]]]:
    """Name, unit and points of each device. On a line that is apart units are not those of the clients."""
    for line in config.line:
        if line.role == "client" and line.devices is None and not config.is_apart(line):
            points = of_profiles[line.profile]
            yield from ((f"{line.label}/{unit}", unit, points) for unit in passing_units(config))
        for row in line.devices or ():
            points = (*of_profiles[row.profile or line.profile], *points_of(row.points))
            named = zip(line.device_names(row), row.client_units, strict=True)
            yield from ((name, unit, points) for name, unit in named)


def _points_in(areas: Mapping[Area, tuple[Range, ...]], points: Iterable[Point]) -> tuple[Point, ...]:
    return tuple(point for point in points if covers(areas.get(point.area, ()), point.span))


def _mirror(image: Image, device: DeviceSettings) -> MirrorSettings:
    polls = tuple(
        Poll(area, first, last, row.every) for row in image.read for area in Area for first, last in row.ranges(area)
    )
    areas = {area: join_ranges((poll.first, poll.last) for poll in polls if poll.area is area) for area in Area}
    return MirrorSettings(
        image.unit, image.label, device.name, device.profile, polls, areas, image.stale, source=image.source
    )


def _access(row: Access) -> Row:
    return Row(
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
