"""The status of a gateway: one snapshot for all commands and pages.

Counts are since the start. Durations have their unit in their name.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from gateway.clock.slices import in_slices
from gateway.clock.times import milliseconds, optional_ms
from gateway.devices.device import Device
from gateway.images.custom_image import CustomImage
from gateway.images.image import Image
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.lines.breaker import Breaker
from gateway.lines.counts import total, total_of_units
from gateway.operator.operations.answers.status import (
    ClientStatus,
    HeardCounts,
    ImageStatus,
    LeaseStatus,
    LineStatus,
    LineUserStatus,
    ListenerStatus,
    MirrorStatus,
    MonitorStatus,
    MovedStatus,
    RangeStatus,
    RejectionStatus,
    ServerStatus,
    SourceStatus,
    Status,
    TimesStatus,
    UnitStatus,
    UnknownUnitStatus,
    UpstreamStatus,
    VirtualStatus,
)
from gateway.operator.operations.answers.unit_status import UnitWithStatus
from gateway.operator.operations.asked import OneUnit
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operator import Operator
from gateway.operator.status.troubles import troubles
from gateway.operator.status.unit_states import SLOTS, each_state, each_state_now
from gateway.operator.status.virtual_sources import source_states
from gateway.operator.units.units import picture
from gateway.ports.reconnector import Reconnector
from gateway.readconfig.expiry import certificates
from gateway.runtime.gateway import Gateway, Listener, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.recent import LineUser, Recent
from gateway.timing.histogram import SECONDS, SHARES, merged
from gateway.timing.measured import NEVER, Phases, Times

if TYPE_CHECKING:
    from gateway.runtime.running import Running

#: How many users of a line are shown.
MOST_USERS: Final = 20
#: How old the status may be over HTTP, in seconds: any number of readers costs no more than one.
KEPT: Final = 1.0


async def tell_status(operator: Operator, _asked: Nothing, asker: Asker) -> Status:
    """Return the status: the present one at the control socket, one of less than a second ago over HTTP."""
    return await (_with_troubles(operator) if asker.door == "control" else recent_status(operator))


class _Last:
    """The last status that was made."""

    def __init__(self) -> None:
        self.status: Status | None = None
        self.one_at_a_time = asyncio.Lock()


async def recent_status(operator: Operator) -> Status:
    """Return the status of now, or the same object again for less than a second."""
    last = operator.kept(_Last)
    async with last.one_at_a_time:
        now = asyncio.get_running_loop().time()
        if last.status is None or now - last.status.at >= KEPT:
            last.status = await _with_troubles(operator)
        return last.status


async def _with_troubles(operator: Operator) -> Status:
    """Make the status and find what is wrong in it; without a history, what is wrong with units at this moment."""
    whole = await status_in_slices(operator.running)
    if operator.history is None:
        found = each_state_now(whole.units)
    else:
        found = each_state(whole.units, operator.history.last(operator.clock(), SLOTS))
    states = dict(await in_slices(found))
    is_rejected = not operator.running.reload_succeeded
    return replace(whole, troubles=tuple(troubles(whole, states, is_rejected=is_rejected)))


async def status_in_slices(running: "Running") -> Status:
    """Make the status, with pauses for the lines: each unit is shown as it was in its turn."""
    gateway, recent = running.gateway, running.recent
    clock = asyncio.get_running_loop().time
    units = await in_slices(_unit(owner, device, clock()) for owner, device in _devices(gateway))
    lines = await in_slices(_line(each, recent, clock()) for each in gateway.lines)
    virtual = [await _virtual(each.unit) for each in gateway.virtual]
    now = clock()
    return Status(
        at=now,
        site=gateway.plan.site,
        page=running.page,
        listeners=tuple(_listener(each) for each in gateway.listeners),
        clients=tuple(each for listener in gateway.listeners for each in _clients(listener, now)),
        rejections=tuple(each for listener in gateway.listeners for each in _rejections(listener, now)),
        lines=tuple(lines),
        servers=tuple(_server(each) for each in gateway.servers),
        upstreams=tuple(_upstream(each, recent, now) for each in gateway.upstreams),
        monitors=tuple(_monitor(each, recent, now) for each in gateway.monitors),
        units=tuple(units),
        images=tuple(_image(each, now) for each in gateway.images),
        mirrors=tuple(_mirror(each.unit, now) for each in gateway.mirrors),
        virtual=tuple(virtual),
        certificates=tuple(certificates(running.contexts, time.time())),
        leases=tuple(_leases(gateway.lines)),
        moved=tuple(_moved(gateway.lines)),
        state_files=() if running.troubles is None else running.troubles.status(),
        **_of_add_ons(running),
    )


async def tell_unit_with_status(operator: Operator, asked: OneUnit, _asker: Asker) -> UnitWithStatus:
    """Describe the unit with this number or name, and how it is doing.

    Raises:
        WrongQuestion: there is none.
    """
    found = picture(operator, asked.unit)
    status = await part_of_unit(operator.gateway, found.unit, found.name)
    return UnitWithStatus(**fields_of(found), status=status)


async def part_of_unit(
    gateway: Gateway, unit: int | None, name: str
) -> UnitStatus | ImageStatus | MirrorStatus | VirtualStatus | None:
    """Make the part of the status about one unit; None if there is none."""
    now = asyncio.get_running_loop().time()
    for owner, device in _devices(gateway):
        if (device.settings.client_unit, device.settings.name) == (unit, name):
            return _unit(owner, device, now)
    for driver in gateway.virtual:
        if driver.name == name:
            return await _virtual(driver.unit)
    parts: tuple[ImageStatus | MirrorStatus, ...]
    parts = (*(_image(each, now) for each in gateway.images), *(_mirror(each.unit, now) for each in gateway.mirrors))
    return next((each for each in parts if (each.unit, each.name) == (unit, name)), None)


def _of_add_ons(running: "Running") -> dict[str, Any]:
    """Collect the state of each add-on by its field of the status; empty if it is not configured."""
    told = ((each.shown_as, each.status()) for each in running.add_ons)
    return {field: () if one is None else (one,) for field, one in told}


def _devices(gateway: Gateway) -> list[tuple[Owner, Device]]:
    return [(owner, device) for owner in gateway.owners for device in owner.all_devices]


def _listener(listener: Listener) -> ListenerStatus:
    return ListenerStatus(
        name=listener.settings.name,
        address=listener.address,
        clients=listener.clients,
        accepted=listener.counts.accepted,
        rejected=listener.counts.rejected,
        denied=listener.router.counts.denied,
        no_route=listener.router.counts.no_route,
        most=listener.settings.clients,
    )


def _clients(listener: Listener, now: float) -> Iterator[ClientStatus]:
    for each in listener.connected_clients:
        yield ClientStatus(
            each.caller.client, listener.settings.name, _since(each.last_asked, now), each.asked, each.in_progress
        )


def _rejections(listener: Listener, now: float) -> Iterator[RejectionStatus]:
    for host, each in reversed(listener.counts.rejections.items()):
        yield RejectionStatus(host, listener.settings.name, each.count, milliseconds(now - each.at), each.reason)


def _line(parts: GatewayLine, recent: Recent, now: float) -> LineStatus:
    line, timing = parts.driver.line, parts.driver.line.settings.timing
    rate, phases = recent.rate(parts, now), line.phases(now)
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
        users=tuple(_users(parts, recent.users(parts, now))),
    )


def _leases(lines: Iterable[GatewayLine]) -> Iterator[LeaseStatus]:
    for line in lines:
        if line.standby is not None:
            lease, name = line.standby.lease, line.standby.name
            yield LeaseStatus(line.name, name, lease.is_held, lease.holder, line.standby.taken, lease.trouble)


def _users(parts: GatewayLine | GatewayMonitor, users: Sequence[LineUser]) -> Iterator[LineUserStatus]:
    names = {device.unit: device.settings.name for device in parts.devices.values()}
    for (client, unit, function), share, per_second in users[:MOST_USERS]:
        name = names.get(unit, "")
        yield LineUserStatus(client, unit, name, function, round(share, 4), round(per_second, 2))


def _server(parts: GatewayServer) -> ServerStatus:
    settings, timing = parts.plan.line, parts.plan.line.timing
    return ServerStatus(
        name=settings.name,
        source=settings.source,
        port=parts.port,
        state=_port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
        programs=parts.programs,
        wire=parts.driver.wire,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        serves=tuple(sorted(settings.serves)),
        counts=replace(parts.driver.counts),
    )


def _upstream(parts: GatewayUpstream, recent: Recent, now: float) -> UpstreamStatus:
    upstream, rate = parts.driver.upstream, recent.rate(parts, now)
    return UpstreamStatus(
        name=parts.name,
        source=upstream.settings.source,
        to=parts.reconnector.port_path,
        state=_port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
        queue=upstream.waiting,
        under_way=upstream.under_way,
        overdue=upstream.overdue,
        busy_share=rate and round(rate.busy, 3),
        requests_per_s=rate and round(rate.per_second, 1),
        unasked_frames=upstream.unasked_frames,
        counts=total_of_units(parts.counts),
    )


def _monitor(parts: GatewayMonitor, recent: Recent, now: float) -> MonitorStatus:
    settings, timing, counts = parts.plan.line, parts.plan.line.timing, parts.driver.monitor.counts
    rate = recent.rate(parts, now)
    return MonitorStatus(
        name=parts.name,
        source=settings.source,
        port=parts.reconnector.port_path,
        state=_port_state(parts.reconnector),
        reason=str(parts.reconnector.error or ""),
        wire=parts.driver.wire,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        heard_ms=_since(parts.heard_at, now),
        busy_share=rate and round(rate.busy, 3),
        requests_per_s=rate and round(rate.per_second, 1),
        counts=HeardCounts(
            counts.requests,
            counts.answers,
            counts.sure,
            counts.unanswered,
            counts.strays,
            counts.both_ways,
            counts.noise,
        ),
        unknown_units=tuple(UnknownUnitStatus(*each) for each in parts.unknown_units()),
        users=tuple(_users(parts, recent.users(parts, now))),
    )


def _port_state(reconnector: Reconnector) -> Literal["up", "down", "not tried"]:
    if not reconnector.tried.is_set():
        return "not tried"
    return "up" if reconnector.error is None else "down"


def _unit(parts: Owner, device: Device, now: float) -> UnitStatus:
    settings, breaker, counts = device.settings, device.breaker, device.counts
    times = {function: counts.times[function] for function in counts}
    return UnitStatus(
        line=parts.name,
        unit=settings.client_unit,
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
                unit, configured = device.settings.client_unit, device.moved_from
                yield MovedStatus(line.name, unit, device.name, units, configured, failures)


def _image(image: Image, now: float) -> ImageStatus:
    settings, counts = image.settings, image.counts
    breaker = image.breaker if isinstance(image, CustomImage) else None
    return ImageStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        requests=counts.requests,
        exceptions=counts.exceptions,
        python=settings.python,
        timeout_ms=milliseconds(settings.timeout) if settings.python else 0.0,
        state="" if breaker is None else _unit_state(breaker, now),
        rests_ms=0.0 if breaker is None else milliseconds(breaker.rest_left(now)),
    )


def _mirror(mirror: Mirror, now: float) -> MirrorStatus:
    settings, answers, counts = mirror.settings, mirror.answer_counts, mirror.counts
    return MirrorStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        of=settings.of,
        requests=answers.requests,
        exceptions=answers.exceptions,
        polls=counts.polls,
        failed_polls=counts.failed,
        ranges=tuple(
            RangeStatus(str(poll), milliseconds(poll.every), optional_ms(age)) for poll, age in mirror.ages(now)
        ),
    )


async def _virtual(unit: VirtualUnit) -> VirtualStatus:
    """Make the status of a virtual unit, with pauses for the lines."""
    sources = await in_slices(source_states(unit, asyncio.get_running_loop().time()))
    settings, answers, counts = unit.settings, unit.answer_counts, unit.counts
    told = tuple(SourceStatus(each.device, each.rows, each.fresh, optional_ms(each.age)) for each in sources)
    return VirtualStatus(
        unit=settings.unit,
        name=settings.name,
        source=settings.source,
        requests=answers.requests,
        exceptions=answers.exceptions,
        polls=counts.polls,
        failed_polls=counts.failed,
        age_ms=oldest(each.age_ms for each in told),
        sources=told,
    )


def _times(of: Iterable[Times]) -> TimesStatus:
    """Combine the times of several functions. The limit is the longest one."""
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


def oldest(ages: Iterable[float | None]) -> float | None:
    """Return the oldest age; None if one is not known."""
    known = list(ages)
    return None if None in known else max((age for age in known if age is not None), default=0.0)


def _optional_share(share: float | None) -> float | None:
    return None if share is None else round(share, 3)
