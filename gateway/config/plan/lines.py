"""The settings of lines, server lines and upstreams, and of the devices behind them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final, Literal

from gateway.config.plan.fleet import lease_of
from gateway.config.plan.names import device_names, unit_names, unlisted_units
from gateway.config.plan.reach import listeners_for, own_units, units_without_devices
from gateway.config.plan.settings import (
    NETWORK_LATENCY,
    SHARED_ARRIVES_WITHIN,
    LinePlan,
    ServerPlan,
    UpstreamPlan,
)
from gateway.config.schema.config import Config
from gateway.config.schema.line import Device, Line
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.config.values.character_format import DEFAULT_FORMATS
from gateway.config.values.port import DEVICE_SERVER_MODES
from gateway.config.values.site import Site
from gateway.devices.device import DeviceSettings
from gateway.lines.settings import LineSettings
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.modbus.codes import BROADCAST_UNIT, FunctionCode
from gateway.ports.port import PortSettings, SerialSettings, SiteSettings, TcpSettings
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import LineTiming
from gateway.timing.table import TimingTable
from gateway.tls.settings import ClientTls
from gateway.upstreams.upstream import UpstreamSettings

#: The silence that ends an RTU frame, in characters (S 2.5.1.1), and the shortest turnaround delay (S 2.4.1).
_IDLE_CHARACTERS: Final = 3.5
_SHORTEST_TURNAROUND: Final = 0.1
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
    port = _port(line, timing)
    if isinstance(port, TcpSettings):
        port = replace(port, drops_early=True)
    return ServerPlan(port, settings, line.broadcast_to)


def upstream_plan(upstream: Upstream, config: Config) -> UpstreamPlan:
    """Plan the way to another server, or to the gateway of another site."""
    settings = UpstreamSettings(
        name=upstream.label, timeout=upstream.timeout, in_flight=upstream.in_flight, source=upstream.source
    )
    named = (
        (unit, known_as, name, row.source)
        for row in upstream.units or ()
        for unit, known_as, name in zip(row.units, row.known_as, unit_names(upstream, row), strict=True)
    )
    others = unlisted_units(upstream).items() if listeners_for(upstream, config) else ()
    unnamed = ((unit, unit, name, upstream.source) for unit, name in others)
    return UpstreamPlan(
        _other_server(upstream), settings, tuple(_behind(upstream, named)), tuple(_behind(upstream, unnamed))
    )


def spoken_on(line: Line) -> Literal["rtu", "ascii"]:
    """Tell the mode of a line: what the scheme of a device server says, else its `mode`."""
    return DEVICE_SERVER_MODES[line.port.scheme] if isinstance(line.port, Address) else line.mode


def _timing(line: Line) -> LineTiming:
    """Make the timing of a line: mode, rate and character format."""
    return LineTiming(spoken_on(line), line.baud, line.format or DEFAULT_FORMATS[spoken_on(line)])


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


def _idle_characters(profiles: Iterable[Profile]) -> float:
    """Find the silence that ends a frame for all of these profiles."""
    return max([_IDLE_CHARACTERS, *(profile.idle_chars for profile in profiles)])


def _turnaround(devices: Iterable[DeviceSettings]) -> float:
    """Find the time for the slowest device to act on a broadcast."""
    times = (device.answer_time.margin * device.answer_time.table.slowest for device in devices)
    return max([_SHORTEST_TURNAROUND, *times])


def _devices(line: Line, profiles: dict[str, Profile], config: Config) -> Iterator[DeviceSettings]:
    if line.devices is None:
        row = Device.model_validate({"unit": units_without_devices(line, config)}).placed(line.path, line.source)
        return _of_row(line, row, profiles)
    return (one for row in line.devices for one in _of_row(line, row, profiles))


def _of_row(line: Line, row: Device, profiles: dict[str, Profile]) -> Iterator[DeviceSettings]:
    profile = profiles[row.profile or line.profile]
    if BROADCAST_UNIT in row.units:
        profile = replace(profile, functions=ASKED_AT_ZERO)
    answer_time = _answer_time(line, row, profile)
    for unit, known_as, name in zip(row.units, row.client_units, device_names(line, row), strict=True):
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
    """Choose the answer time of a device.

    Its own time-out has priority; that of the line applies only without a timing table and a named profile.
    """
    if row.timeout is not None:
        return AnswerTime(profile.timing, profile.margin, row.timeout, fixed=True)
    of_line = line.timeout if row.profile is None else None
    return AnswerTime(profile.timing, profile.margin, of_line or profile.timeout)


def _other_server(upstream: Upstream) -> TcpSettings | SiteSettings:
    if isinstance(upstream.to, Site):
        return SiteSettings(str(upstream.to), upstream.to.name)
    return replace(_server(upstream.to, latency=0.0), tls=_client_tls(upstream, upstream.to))


def _client_tls(upstream: Upstream, address: Address) -> ClientTls | None:
    if upstream.certificate is None or upstream.key is None or upstream.ca is None:
        return None
    return ClientTls(upstream.certificate, upstream.key, upstream.ca, upstream.server_name or address.host)


def _behind(upstream: Upstream, units: Iterable[tuple[int, int, str, str]]) -> Iterator[DeviceSettings]:
    """Make these units behind another server, without a profile: the server checks requests itself.

    Each is its number there, the one for clients, its name and its place in the file.
    """
    profile = Profile("upstream")
    answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=upstream.timeout, fixed=True)
    for unit, known_as, name, source in units:
        yield DeviceSettings(name, unit, known_as, profile, answer_time, source=source)
