"""The settings of lines, server lines and upstreams, and of the devices behind them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final, Literal

from gateway.config.plan.add_ons import lease_of
from gateway.config.plan.names import Owner, device_names, keys_of, rows_of, unlisted_units
from gateway.config.plan.profiles import guarded, only_written
from gateway.config.plan.reach import listeners_for, own_units, units_without_devices
from gateway.config.plan.settings import SHARED_ARRIVES_WITHIN, LinePlan, MonitorPlan, ServerPlan, UpstreamPlan
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.config.values.port import DEFAULT_FORMATS, DEVICE_SERVER_MODES, VIRTUAL_FORMAT, VirtualPort
from gateway.config.values.site import Site
from gateway.devices.device import DeviceSettings
from gateway.lines.settings import LineSettings
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, HIGHEST_UNIT, FunctionCode
from gateway.ports.port import PortSettings, PtySettings, SerialSettings, SiteSettings, TcpSettings
from gateway.profiles.profile import Profile
from gateway.timing.budget import NETWORK_LATENCY, AnswerTime
from gateway.timing.characters import LineTiming
from gateway.tls.settings import ClientTls
from gateway.upstreams.settings import UpstreamSettings

#: The silence that ends an RTU frame, in characters (S 2.5.1.1), and the shortest turnaround delay (S 2.4.1).
_IDLE_CHARACTERS: Final = 3.5
_SHORTEST_TURNAROUND: Final = 0.1
#: What clients can ask for: devices that are known by their names only have other keys.
_NUMBERS: Final = frozenset(range(FIRST_UNIT, HIGHEST_UNIT + 1))
#: How long a program may pause within a frame that it writes, in seconds: as much as a serial port's driver may.
_LATENCY_OF_PROGRAMS: Final = 0.005
#: Anything but a read at address 0 is a broadcast.
ASKED_AT_ZERO: Final = frozenset({FunctionCode.READ_HOLDING_REGISTERS})


def line_plan(line: Line, profiles: dict[str, Profile], config: Config) -> LinePlan:
    """Plan a line where the gateway is the client."""
    timing = _timing(line)
    own = own_units(line, config)
    devices = tuple(_devices(line, profiles, config))
    settings, lease = _line_settings(line, timing, devices), lease_of(line, config)
    return LinePlan(_port(line, timing), settings, devices, line.devices is None, own, lease)


def server_plan(line: Line, profiles: Mapping[int, Profile]) -> ServerPlan:
    """Plan a line where an outside client asks; `profiles` are those of all units."""
    timing = _timing(line)
    serves = frozenset(profiles) & _NUMBERS if line.serves == "all" else line.named_units
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
        source=line.place,
    )
    port = _port(line, timing)
    if isinstance(port, TcpSettings):
        port = replace(port, drops_early=True)
    return ServerPlan(port, settings, line.broadcast_to, line.serves == "all")


def monitor_plan(line: Line, profiles: dict[str, Profile], config: Config) -> MonitorPlan:
    """Plan a line where others ask and answer, and the gateway only listens."""
    timing = _timing(line)
    devices = tuple(one for row in line.devices or () for one in _of_row(line, row, profiles, config))
    port = _port(line, timing)
    if not isinstance(port, PtySettings):  # nobody but a client of this gateway is there, so it is refused
        port = replace(port, listens=True)
    return MonitorPlan(port, _line_settings(line, timing, devices), devices)


def upstream_plan(upstream: Upstream, profiles: dict[str, Profile], config: Config) -> UpstreamPlan:
    """Plan the way to another server, or to the gateway of another site."""
    is_one_by_one = upstream.gap > 0 or upstream.transaction_id == "zero"
    settings = UpstreamSettings(
        name=upstream.label,
        in_flight=1 if is_one_by_one else upstream.in_flight,
        gap=upstream.gap,
        after_connect=upstream.after_connect,
        idle=upstream.idle,
        coalesce=upstream.coalesce and not isinstance(upstream.to[0], Site),  # the owner does, client by client
        retries=upstream.retries,
        rest=upstream.rest,
        queue=upstream.queue,
        max_wait=upstream.max_wait,
        transaction_id=upstream.transaction_id,
        source=upstream.place,
    )
    port, *others = (_other_server(upstream, to) for to in upstream.to)
    (usual,) = _of_row(upstream, Device.model_validate({"unit": 1}), profiles, config)
    return UpstreamPlan(
        port,
        settings,
        devices=tuple(one for row in rows_of(upstream) for one in _of_row(upstream, row, profiles, config)),
        others=tuple(other for other in others if isinstance(other, TcpSettings)),
        usual=usual,
        unlisted=unlisted_units(upstream) if listeners_for(upstream, config) else {},
    )


def spoken_on(line: Line) -> Literal["rtu", "ascii"]:
    """Tell the mode of a line: what the scheme of a device server says, else its `mode`."""
    return DEVICE_SERVER_MODES[line.port.scheme] if isinstance(line.port, Address) else line.mode


def _timing(line: Line) -> LineTiming:
    """Make the timing of a line: mode, rate and character format."""
    format_ = VIRTUAL_FORMAT if line.is_virtual else line.format or DEFAULT_FORMATS[spoken_on(line)]
    return LineTiming(spoken_on(line), line.baud, format_)


def _port(line: Line, timing: LineTiming) -> PortSettings:
    if isinstance(line.port, Address):
        server = _server(line.port, NETWORK_LATENCY if line.latency is None else line.latency)
        server = replace(server, after_connect=line.after_connect)
        return server if line.lease is None else replace(server, arrives_within=SHARED_ARRIVES_WITHIN)
    if isinstance(line.port, VirtualPort):
        latency = _LATENCY_OF_PROGRAMS if line.latency is None else line.latency
        return PtySettings(str(line.port), line.port.name, line.group, latency)
    return SerialSettings(line.port, line.baud, timing.format, line.rs485, line.latency, rs485_delay=line.rs485_delay)


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
        idle=line.idle,
        after_connect=line.after_connect,
        echo=line.echo,
        wire=line.wire,
        coalesce=line.coalesce,
        queue=line.queue,
        max_wait=line.max_wait,
        broadcast=line.broadcast,
        source=line.place,
    )


def _idle_characters(profiles: Iterable[Profile]) -> float:
    """Find the silence that ends a frame for all of these profiles."""
    return max([_IDLE_CHARACTERS, *(profile.idle_chars for profile in profiles)])


def _turnaround(devices: Iterable[DeviceSettings]) -> float:
    """Find the time for the slowest device to act on a broadcast."""
    times = (device.answer_time.margin * device.answer_time.table.slowest for device in devices)
    return max([_SHORTEST_TURNAROUND, *times])


def _devices(line: Line, profiles: dict[str, Profile], config: Config) -> Iterator[DeviceSettings]:
    if line.devices is None:
        row = Device.model_validate({"unit": units_without_devices(line, config)}).placed(line.path, line.place)
        return _of_row(line, row, profiles, config)
    return (one for row in line.devices for one in _of_row(line, row, profiles, config))


def _of_row(owner: Owner, row: Device, profiles: dict[str, Profile], config: Config) -> Iterator[DeviceSettings]:
    kind = row.profile or owner.profile
    profile = profiles[kind]
    own = only_written(row.points, config.profile[kind])
    if own:
        profile = replace(profile, only_written=(*profile.only_written, *own))
    limited = guarded(row.points, config.profile[kind])
    if limited:
        profile = profile.guarding((*profile.guards.points, *limited))
    if BROADCAST_UNIT in row.units and isinstance(owner, Line):
        profile = replace(profile, functions=ASKED_AT_ZERO)
    answer_time, wake = _answer_time(owner, row, profile), _wake(owner, row, profile)
    for unit, known_as, name in zip(row.units, keys_of(owner, row), device_names(owner, row), strict=True):
        yield DeviceSettings(
            name=name,
            unit=unit,
            known_as=known_as,
            profile=profile,
            answer_time=answer_time,
            priority=row.priority,
            wake=wake,
            source=row.place,
        )


def _wake(owner: Owner, row: Device, profile: Profile) -> float:
    """Choose the time after which a device sleeps; 0 for never."""
    if _is_site(owner):  # its own gateway wakes it
        return 0.0
    return row.wake if row.wake is not None else profile.wake or owner.wake


def _answer_time(owner: Owner, row: Device, profile: Profile) -> AnswerTime:
    """Choose the answer time of a device.

    Its own time-out has priority; that of the line or upstream applies only without a timing table and a named profile.
    Behind another site it applies to every function: there, requests of others have their turns too.
    """
    if row.timeout is not None:
        return AnswerTime(profile.timing, profile.margin, row.timeout, fixed=True)
    of_owner = owner.timeout if row.profile is None else None
    return AnswerTime(profile.timing, profile.margin, of_owner or profile.timeout, fixed=_is_site(owner))


def _is_site(owner: Owner) -> bool:
    """Tell whether its devices are those of the gateway of another site."""
    return isinstance(owner, Upstream) and isinstance(owner.to[0], Site)


def _other_server(upstream: Upstream, to: Address | Site) -> TcpSettings | SiteSettings:
    if isinstance(to, Site):
        return SiteSettings(str(to), to.name)
    server = _server(to, latency=0.0)
    return replace(server, tls=_client_tls(upstream, to), after_connect=upstream.after_connect)


def _client_tls(upstream: Upstream, address: Address) -> ClientTls | None:
    if upstream.certificate is None or upstream.key is None or upstream.ca is None:
        return None
    return ClientTls(upstream.certificate, upstream.key, upstream.ca, upstream.server_name or address.host)
