"""The status of a gateway: one snapshot for all commands. `dataclasses.asdict` converts it for JSON.

Counts are since the start. Durations have their unit in their name.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from gateway.clock.slices import in_slices
from gateway.devices.device import Device
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.lines.breaker import Breaker
from gateway.lines.counts import Counts, total, total_of_units
from gateway.listeners.sessions.server_line import ServerCounts
from gateway.ports.port import Wire
from gateway.ports.reconnector import Reconnector
from gateway.readconfig.expiry import CertificateStatus, certificates
from gateway.runtime.build import Gateway, Listener
from gateway.runtime.fleet import FleetStatus
from gateway.runtime.parts import GatewayLine, GatewayServer, GatewayUpstream
from gateway.runtime.publishing import BrokerStatus
from gateway.runtime.recent import LineUser, Recent
from gateway.state.troubles import StateFileStatus
from gateway.timing.histogram import SECONDS, SHARES, merged
from gateway.timing.measured import NEVER, Phases, Times

if TYPE_CHECKING:
    from gateway.runtime.running import Running

#: How many users of a line are told.
MOST_USERS: Final = 20


@dataclass(frozen=True, slots=True)
class ListenerStatus:
    """An address where clients connect. `denied` and `no_route` are requests that were sent to no unit."""

    name: str
    address: str
    clients: int
    accepted: int
    rejected: int
    denied: int
    no_route: int


@dataclass(frozen=True, slots=True)
class ClientStatus:
    """A client that is connected, or has sent datagrams. Its last request was so long ago; None if there was none.

    Of its `requests` so many are `in_progress`: they have no response yet.
    """

    client: str
    listener: str
    asked_ms: float | None
    requests: int
    in_progress: int


@dataclass(frozen=True, slots=True)
class RejectionStatus:
    """Clients at the address `host` that were rejected: how many, how long ago the last one, and why."""

    host: str
    listener: str
    count: int
    last_ms: float
    reason: str


@dataclass(frozen=True, slots=True)
class LineUserStatus:
    """Who took up a line in the last minute: a client's requests with one function to the unit `on_the_wire`.

    `share` is that of the line's time. `client` is an address, the name of a mirror or of a server line, `control`, or
    `others` for all that the table had no place for; `device` is empty then, and for broadcasts.
    """

    client: str
    on_the_wire: int
    device: str
    function: int
    share: float
    requests_per_s: float


@dataclass(frozen=True, slots=True)
class LeaseStatus:
    """The lease of a `line`. `holder` is who holds it, empty if nobody is known; this gateway has it if it `is_held`.

    It was `taken` so often. `trouble` is why NATS was not reached last, empty if it was.
    """

    line: str
    name: str
    is_held: bool
    holder: str
    taken: int
    trouble: str


@dataclass(frozen=True, slots=True)
class LineStatus:
    """A client line. `reason` says why it is down, or standby: then another gateway may ask there, which has its lease.

    `late_windows` is how many late responses are still expected.

    `wire` may be `auto` until the port was open once.

    `phases` are the seconds spent on requests, waiting for responses, responses, and the silences after them; `busy_s`
    is their sum. `busy_share` and requests per second are of the last minute; None in the first second. `counts` are
    those of all its units and of its broadcasts. `users` took most of its time in the last minute, at
    most MOST_USERS of them.
    """

    name: str
    source: str
    port: str
    state: Literal["up", "down", "standby", "not tried"]
    reason: str
    wire: Wire
    mode: str
    baud: int
    format: str
    queue: int
    late_windows: int
    busy_s: float
    busy_share: float | None
    requests_per_s: float | None
    phases: Phases
    unasked_bytes: int
    counts: Counts
    users: tuple[LineUserStatus, ...]


@dataclass(frozen=True, slots=True)
class ServerStatus:
    """A server line, which answers for the units in `serves`. `reason` says why it is down."""

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

    `overdue` is how many late responses are still expected. `counts` are those of all its units.
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
class TimesStatus:
    """How long requests took: median and 99th percentile, estimated from fixed buckets.

    `wait` is until a request was sent; `answer` is from its last character to the last one of a valid response;
    `limit_share` is the share of the limit that this took. `limit_ms` is the last limit. None before the first request.
    `late` more responses came after their limit.
    """

    wait_p50_ms: float | None
    wait_p99_ms: float | None
    answer_p50_ms: float | None
    answer_p99_ms: float | None
    limit_share_p50: float | None
    limit_share_p99: float | None
    limit_ms: float | None
    late: int


@dataclass(frozen=True, slots=True)
class UnitStatus:
    """A unit on a line or behind an upstream, which `line` names: `unit` to clients, `on_the_wire` there.

    It is failing after `failures` in a row, and after three of them it backs off: `rests_ms` are left of that. The last
    valid response was `last_answer_ms` ago, the last error after a request was sent `last_error_ms` ago.
    `exceptions` are those of the unit itself, by code. `functions` are the counts of each function that was requested,
    0 for all unknown ones, and `function_times` their times; `times` are those of all. A client's time-out should be
    longer than `longest_wait_ms`.
    """

    line: str
    unit: int
    on_the_wire: int
    name: str
    source: str
    profile: str
    state: Literal["fine", "failing", "resting", "line down"]
    failures: int
    rests_ms: float
    last_answer_ms: float | None
    last_error: str
    last_error_ms: float | None
    longest_wait_ms: float
    counts: Counts
    times: TimesStatus
    exceptions: Mapping[int, int]
    functions: Mapping[int, Counts]
    function_times: Mapping[int, TimesStatus]


@dataclass(frozen=True, slots=True)
class MovedStatus:
    """A unit that is, or may be, at another address than the `configured` one: at one of those in `on_the_wire`.

    Its last `failures` requests in a row have failed.
    """

    line: str
    unit: int
    name: str
    on_the_wire: tuple[int, ...]
    configured: int
    failures: int


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
    """Addresses that a mirror polls, and the age of their values; None while they are unknown."""

    addresses: str
    every_ms: float
    age_ms: float | None


@dataclass(frozen=True, slots=True)
class MirrorStatus:
    """A mirror of the device `of`."""

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
    """The whole gateway, in the order of its config, at the time `at` of the loop's clock, in seconds."""

    at: float
    listeners: tuple[ListenerStatus, ...]
    clients: tuple[ClientStatus, ...]
    rejections: tuple[RejectionStatus, ...]
    lines: tuple[LineStatus, ...]
    servers: tuple[ServerStatus, ...]
    upstreams: tuple[UpstreamStatus, ...]
    units: tuple[UnitStatus, ...]
    images: tuple[ImageStatus, ...]
    mirrors: tuple[MirrorStatus, ...]
    certificates: tuple[CertificateStatus, ...] = ()
    brokers: tuple[BrokerStatus, ...] = ()
    fleets: tuple[FleetStatus, ...] = ()
    leases: tuple[LeaseStatus, ...] = ()
    moved: tuple[MovedStatus, ...] = ()
    state_files: tuple[StateFileStatus, ...] = ()
    #: The name of the plant, and the address of the web page; empty if there is none.
    site: str = ""
    page: str = ""


def status(gateway: Gateway, now: float, recent: Recent | None = None) -> Status:
    """The status of `gateway` at `now`, with rates from `recent` if given."""
    units = [_unit(owner, device, now) for owner, device in _devices(gateway)]
    return _status(gateway, now, [_line(each, recent, now) for each in gateway.lines], units)


async def status_in_slices(running: "Running") -> Status:
    """Make the status, with pauses for the lines: each unit is shown as it was when it was its turn."""
    gateway, recent = running.gateway, running.recent
    now = asyncio.get_running_loop().time
    units = await in_slices(_unit(owner, device, now()) for owner, device in _devices(gateway))
    lines = await in_slices(_line(each, recent, now()) for each in gateway.lines)
    whole = _status(gateway, now(), lines, units)
    troubles = () if running.troubles is None else running.troubles.status()
    return replace(whole, page=running.page, state_files=troubles)


def _status(gateway: Gateway, now: float, lines: Iterable[LineStatus], units: Iterable[UnitStatus]) -> Status:
    broker, fleet = gateway.publishing.status(), gateway.fleet.status()
    return Status(
        at=now,
        site=gateway.plan.site,
        listeners=tuple(_listener(each) for each in gateway.listeners),
        clients=tuple(each for listener in gateway.listeners for each in _clients(listener, now)),
        rejections=tuple(each for listener in gateway.listeners for each in _rejections(listener, now)),
        lines=tuple(lines),
        servers=tuple(_server(each) for each in gateway.servers),
        upstreams=tuple(_upstream(each) for each in gateway.upstreams),
        units=tuple(units),
        images=tuple(_image(each) for each in gateway.images),
        mirrors=tuple(_mirror(each.mirror, now) for each in gateway.mirrors),
        certificates=tuple(certificates(gateway.contexts, time.time())),
        brokers=() if broker is None else (broker,),
        fleets=() if fleet is None else (fleet,),
        leases=tuple(_leases(gateway.lines)),
        moved=tuple(_moved(gateway.lines)),
    )


def _devices(gateway: Gateway) -> list[tuple[GatewayLine | GatewayUpstream, Device]]:
    owners: tuple[GatewayLine | GatewayUpstream, ...] = (*gateway.lines, *gateway.upstreams)
    return [(owner, device) for owner in owners for device in owner.all_devices]


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


def _clients(listener: Listener, now: float) -> Iterator[ClientStatus]:
    for each in listener.connected_clients:
        yield ClientStatus(
            each.caller.client, listener.settings.name, _since(each.last_asked, now), each.asked, each.in_progress
        )


def _rejections(listener: Listener, now: float) -> Iterator[RejectionStatus]:
    for host, each in reversed(listener.counts.rejections.items()):
        yield RejectionStatus(host, listener.settings.name, each.count, milliseconds(now - each.at), each.reason)


def _line(parts: GatewayLine, recent: Recent | None, now: float) -> LineStatus:
    line, timing = parts.driver.line, parts.driver.line.settings.timing
    rate = None if recent is None else recent.rate(parts, now)
    users = [] if recent is None else recent.users(parts, now)[:MOST_USERS]
    phases = line.phases(now)
    return LineStatus(
        name=line.settings.name,
        source=line.settings.source,
        port=parts.reconnector.port_path,
        state="standby" if parts.is_standby else _port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
        wire=parts.driver.wire,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        queue=len(line.queue),
        late_windows=line.ledger.count_late(now),
        busy_s=round(phases.busy, 3),
        busy_share=rate and round(rate.busy, 3),
        requests_per_s=rate and round(rate.per_second, 1),
        phases=Phases(*(round(each, 3) for each in astuple(phases))),
        unasked_bytes=line.unasked_bytes,
        counts=total_of_units(parts.counts),
        users=tuple(_users(parts, users)),
    )


def _leases(lines: Iterable[GatewayLine]) -> Iterator[LeaseStatus]:
    for line in lines:
        if line.standby is not None:
            lease, name = line.standby.lease, line.standby.name
            yield LeaseStatus(line.name, name, lease.is_held, lease.holder, line.standby.taken, lease.trouble)


def _users(parts: GatewayLine, users: Iterable[LineUser]) -> Iterator[LineUserStatus]:
    names = {device.unit: device.settings.name for device in parts.devices.values()}
    for (client, unit, function), share, per_second in users:
        name = names.get(unit, "")
        yield LineUserStatus(client, unit, name, function, round(share, 4), round(per_second, 2))


def _server(parts: GatewayServer) -> ServerStatus:
    settings, timing = parts.plan.line, parts.plan.line.timing
    return ServerStatus(
        name=settings.name,
        source=settings.source,
        port=parts.reconnector.port_path,
        state=_port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
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
        to=parts.reconnector.port_path,
        state=_port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
        queue=upstream.waiting,
        under_way=upstream.under_way,
        overdue=upstream.overdue,
        unasked_frames=upstream.unasked_frames,
        counts=total_of_units(device.counts for device in parts.all_devices),
    )


def _port_state(reconnector: Reconnector) -> Literal["up", "down", "not tried"]:
    if not reconnector.tried.is_set():
        return "not tried"
    return "up" if reconnector.error is None else "down"


def _unit(parts: GatewayLine | GatewayUpstream, device: Device, now: float) -> UnitStatus:
    settings, breaker, counts = device.settings, device.breaker, device.counts
    times = {function: counts.times[function] for function in counts}
    return UnitStatus(
        line=parts.name,
        unit=settings.known_as,
        on_the_wire=device.unit,
        name=settings.name,
        source=settings.source,
        profile=settings.profile.name,
        state="line down" if parts.reconnector.error is not None else _unit_state(breaker, now),
        failures=breaker.failures,
        rests_ms=milliseconds(breaker.rest_left(now)),
        last_answer_ms=_since(max((each.answered_at for each in times.values()), default=NEVER), now),
        last_error=counts.last_error,
        last_error_ms=_since(counts.last_error_at, now),
        longest_wait_ms=milliseconds(parts.longest_wait[settings.name]),
        counts=total_of_units([counts]),
        times=_times(times.values()),
        exceptions=dict(counts.codes),
        functions={function: total([each]) for function, each in counts.items()},
        function_times={function: _times([each]) for function, each in times.items()},
    )


def _unit_state(breaker: Breaker, now: float) -> Literal["fine", "failing", "resting"]:
    if breaker.is_resting(now):
        return "resting"
    return "failing" if breaker.failures else "fine"


def _moved(lines: Iterable[GatewayLine]) -> Iterator[MovedStatus]:
    for line in lines:
        for device in line.devices.values():
            if device.moved_from is not None:
                units, failures = device.possible_units, device.breaker.failures
                known_as, configured = device.settings.known_as, device.moved_from
                yield MovedStatus(line.name, known_as, device.name, units, configured, failures)


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
            RangeStatus(str(poll), milliseconds(poll.every), None if age is None else milliseconds(age))
            for poll, age in mirror.ages(now)
        ),
    )


def _times(of: Iterable[Times]) -> TimesStatus:
    """The times of several functions together. The limit is the longest one."""
    times = tuple(of)
    wait = merged(SECONDS, (each.wait for each in times))
    answer = merged(SECONDS, (each.answer for each in times))
    share = merged(SHARES, (each.share for each in times))
    return TimesStatus(
        wait_p50_ms=optional_ms(wait.quantile(0.5)),
        wait_p99_ms=optional_ms(wait.quantile(0.99)),
        answer_p50_ms=optional_ms(answer.quantile(0.5)),
        answer_p99_ms=optional_ms(answer.quantile(0.99)),
        limit_share_p50=_optional_share(share.quantile(0.5)),
        limit_share_p99=_optional_share(share.quantile(0.99)),
        limit_ms=milliseconds(max((each.limit for each in times), default=0.0)) or None,
        late=sum(each.late for each in times),
    )


def _since(at: float, now: float) -> float | None:
    return None if at == NEVER else milliseconds(now - at)


def optional_ms(seconds: float | None) -> float | None:
    """In milliseconds; None if it is not known."""
    return None if seconds is None else milliseconds(seconds)


def _optional_share(share: float | None) -> float | None:
    return None if share is None else round(share, 3)


def milliseconds(seconds: float) -> float:
    """In milliseconds, to a tenth."""
    return round(seconds * 1000, 1)
