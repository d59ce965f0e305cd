"""How a gateway is doing: one snapshot, for everything that shows it. `dataclasses.asdict` makes JSON of it.

Counts are those since the start. Durations have their unit in their name.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from gateway.devices.device import Device
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.lines.breaker import Breaker
from gateway.lines.counts import Counts, UnitCounts, total
from gateway.listeners.serial_session import Counts as ServerCounts
from gateway.ports.keeper import Keeper
from gateway.ports.wire import Wire
from gateway.service.build import Gateway, Listener
from gateway.service.parts import GatewayLine, GatewayServer, GatewayUpstream


@dataclass(frozen=True, slots=True)
class ListenerStatus:
    """An address where clients connect. `denied` and `no_route` are requests that no unit was asked for."""

    name: str
    address: str
    clients: int
    accepted: int
    rejected: int
    denied: int
    no_route: int


@dataclass(frozen=True, slots=True)
class LineStatus:
    """A line. `reason` says why it is down. `late_windows` is how many late answers are awaited.

    `wire` is how bytes travel; it may be `auto` as long as its port was never open.

    `busy_s` is how long something was asked on it: the share of a time is the difference over that time. `counts` are
    those of all its units and of its broadcasts.
    """

    name: str
    source: str
    port: str
    state: Literal["up", "down", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    queue: int
    late_windows: int
    busy_s: float
    unasked_bytes: int
    counts: Counts


@dataclass(frozen=True, slots=True)
class ServerStatus:
    """A line where an outside client asks us for the units that it `serves`. `reason` says why it is down."""

    name: str
    source: str
    port: str
    state: Literal["up", "down", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    serves: tuple[int, ...]
    counts: ServerCounts


@dataclass(frozen=True, slots=True)
class UpstreamStatus:
    """A connection to another server. `reason` says why there is none. `queue` requests wait, and `under_way` are sent.

    `overdue` is how many late answers are awaited. `counts` are those of all its units.
    """

    name: str
    source: str
    to: str
    state: Literal["up", "down", "not tried"]
    reason: str
    queue: int
    under_way: int
    overdue: int
    unasked_frames: int
    counts: Counts


@dataclass(frozen=True, slots=True)
class UnitStatus:
    """A unit on a line or behind an upstream, which `line` names: `unit` to clients, `on_the_wire` there.

    It is failing after `failures` in a row, and after three of them it rests: `rests_ms` are left of that.
    `exceptions` are those of the unit itself, by code. `functions` are the counts of each function that was asked, 0
    standing for all that the gateway does not know. A client's time-out should be longer than `longest_wait_ms`.
    """

    line: str
    unit: int
    on_the_wire: int
    name: str
    source: str
    profile: str
    state: Literal["fine", "failing", "resting"]
    failures: int
    rests_ms: float
    last_error: str
    longest_wait_ms: float
    counts: Counts
    exceptions: Mapping[int, int]
    functions: Mapping[int, Counts]


@dataclass(frozen=True, slots=True)
class ImageStatus:
    """A unit that the gateway answers itself."""

    unit: int
    name: str
    source: str
    requests: int
    exceptions: int


@dataclass(frozen=True, slots=True)
class RangeStatus:
    """Addresses that a mirror polls, and how old their values are; None while they are not known."""

    addresses: str
    every_ms: float
    age_ms: float | None


@dataclass(frozen=True, slots=True)
class MirrorStatus:
    """A unit that the gateway answers from what it polls of the device `of`."""

    unit: int
    name: str
    source: str
    of: str
    requests: int
    exceptions: int
    polls: int
    failed_polls: int
    ranges: tuple[RangeStatus, ...]


@dataclass(frozen=True, slots=True)
class Status:
    """The whole gateway, in the order of its config. `at` is when: in seconds of the loop's clock."""

    at: float
    listeners: tuple[ListenerStatus, ...]
    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
    units: tuple[UnitStatus, ...]
    images: tuple[ImageStatus, ...]
    mirrors: tuple[MirrorStatus, ...]


def status(gateway: Gateway, now: float) -> Status:
    """How `gateway` is doing at `now`."""
    owners: tuple[GatewayLine | GatewayUpstream, ...] = (*gateway.lines, *gateway.upstreams)
    return Status(
        at=now,
        listeners=tuple(_listener(each) for each in gateway.listeners),
        lines=tuple(_line(each, now) for each in gateway.lines),
        servers=tuple(_server(each) for each in gateway.servers),
        upstreams=tuple(_upstream(each) for each in gateway.upstreams),
        units=tuple(_unit(owner, device, now) for owner in owners for device in owner.devices.values()),
        images=tuple(_image(each) for each in gateway.images),
        mirrors=tuple(_mirror(each.mirror, now) for each in gateway.mirrors),
    )


def _listener(listener: Listener) -> ListenerStatus:
    return ListenerStatus(
        name=listener.settings.name,
        address=listener.address,
        clients=listener.clients,
        accepted=listener.counts.accepted,
        rejected=listener.counts.rejected,
        denied=listener.router.counts.denied,
        no_route=listener.router.counts.no_route,
    )


def _line(parts: GatewayLine, now: float) -> LineStatus:
    line, timing = parts.driver.line, parts.driver.line.settings.timing
    return LineStatus(
        name=line.settings.name,
        source=line.settings.source,
        port=parts.keeper.port_path,
        state=_port_state(parts.keeper),
        reason=str(parts.keeper.error or ""),
        wire=parts.driver.wire,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        queue=line.waiting,
        late_windows=line.late_windows(now),
        busy_s=round(line.busy_seconds, 3),
        unasked_bytes=line.unasked_bytes,
        counts=_sum([parts.every_device.counts, *(device.counts for device in parts.devices.values())]),
    )


def _server(parts: GatewayServer) -> ServerStatus:
    settings, timing = parts.plan.line, parts.plan.line.timing
    return ServerStatus(
        name=settings.name,
        source=settings.source,
        port=parts.keeper.port_path,
        state=_port_state(parts.keeper),
        reason=str(parts.keeper.error or ""),
        wire=parts.driver.wire,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        serves=tuple(sorted(settings.serves)),
        counts=replace(parts.driver.session.counts),
    )


def _upstream(parts: GatewayUpstream) -> UpstreamStatus:
    upstream = parts.driver.upstream
    return UpstreamStatus(
        name=parts.name,
        source=upstream.settings.source,
        to=parts.keeper.port_path,
        state=_port_state(parts.keeper),
        reason=str(parts.keeper.error or ""),
        queue=upstream.waiting,
        under_way=upstream.under_way,
        overdue=upstream.overdue,
        unasked_frames=upstream.unasked_frames,
        counts=_sum(device.counts for device in parts.devices.values()),
    )


def _port_state(keeper: Keeper) -> Literal["up", "down", "not tried"]:
    if not keeper.tried.is_set():
        return "not tried"
    return "up" if keeper.error is None else "down"


def _unit(parts: GatewayLine | GatewayUpstream, device: Device, now: float) -> UnitStatus:
    settings, breaker = device.settings, device.breaker
    return UnitStatus(
        line=parts.name,
        unit=settings.known_as,
        on_the_wire=device.unit,
        name=settings.name,
        source=settings.source,
        profile=settings.profile.name,
        state=_unit_state(breaker, now),
        failures=breaker.failures,
        rests_ms=_milliseconds(breaker.rest_left(now)),
        last_error=device.counts.last_error,
        longest_wait_ms=_milliseconds(parts.longest_wait[settings.known_as]),
        counts=_sum([device.counts]),
        exceptions=dict(device.counts.codes),
        functions={function: total([counts]) for function, counts in device.counts.items()},
    )


def _unit_state(breaker: Breaker, now: float) -> Literal["fine", "failing", "resting"]:
    if breaker.rests(now):
        return "resting"
    return "failing" if breaker.failures else "fine"


def _image(image: Image) -> ImageStatus:
    settings, counts = image.settings, image.counts
    return ImageStatus(settings.unit, settings.name, settings.source, counts.requests, counts.exceptions)


def _mirror(mirror: Mirror, now: float) -> MirrorStatus:
    settings, counts = mirror.settings, mirror.counts
    return MirrorStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        of=settings.of,
        requests=counts.requests,
        exceptions=counts.exceptions,
        polls=counts.polls,
        failed_polls=counts.failed_polls,
        ranges=tuple(
            RangeStatus(str(poll), _milliseconds(poll.every), None if age is None else _milliseconds(age))
            for poll, age in mirror.ages(now)
        ),
    )


def _sum(units: Iterable[UnitCounts]) -> Counts:
    return total(counts for unit in units for counts in unit.values())


def _milliseconds(seconds: float) -> float:
    return round(seconds * 1000, 1)
