"""The part of the status about lines, server lines, upstreams and monitor lines."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, fields, replace
from operator import attrgetter
from typing import Final, Literal

from gateway.lines.counts import total_of_units
from gateway.operator.operations.answers.status import (
    HeardCounts,
    LeaseStatus,
    LineStatus,
    LineUserStatus,
    MonitorStatus,
    ServerStatus,
    UnknownUnitStatus,
    UpstreamStatus,
)
from gateway.operator.status.unit_status import ago_ms
from gateway.ports.reconnector import Reconnector
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.recent import LineUser, Recent
from gateway.timing.measured import Phases

#: How many users of a line are shown.
MOST_USERS: Final = 20
_HEARD: Final = attrgetter(*(each.name for each in fields(HeardCounts)))


def line_status(parts: GatewayLine, recent: Recent, now: float) -> LineStatus:
    """Make the status of a client line."""
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


def leases(lines: Iterable[GatewayLine]) -> Iterator[LeaseStatus]:
    """Make the status of the leases of lines."""
    for line in lines:
        if line.standby is not None:
            lease, name = line.standby.lease, line.standby.name
            yield LeaseStatus(line.name, name, lease.is_held, lease.holder, line.standby.taken, lease.trouble)


def _users(parts: GatewayLine | GatewayMonitor, users: Sequence[LineUser]) -> Iterator[LineUserStatus]:
    names = {device.unit: device.settings.name for device in parts.devices.values()}
    for (client, unit, function), share, per_second in users[:MOST_USERS]:
        name = names.get(unit, "")
        yield LineUserStatus(client, unit, name, function, round(share, 4), round(per_second, 2))


def server_status(parts: GatewayServer) -> ServerStatus:
    """Make the status of a server line."""
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


def upstream_status(parts: GatewayUpstream, recent: Recent, now: float) -> UpstreamStatus:
    """Make the status of a connection to another server."""
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


def monitor_status(parts: GatewayMonitor, recent: Recent, now: float) -> MonitorStatus:
    """Make the status of a line that only listens."""
    settings, timing = parts.plan.line, parts.plan.line.timing
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
        heard_ms=ago_ms(parts.heard_at, now),
        busy_share=rate and round(rate.busy, 3),
        requests_per_s=rate and round(rate.per_second, 1),
        counts=HeardCounts(*_HEARD(parts.driver.monitor.counts)),
        unknown_units=tuple(UnknownUnitStatus(*each) for each in parts.unknown_units()),
        users=tuple(_users(parts, recent.users(parts, now))),
    )


def _port_state(reconnector: Reconnector) -> Literal["up", "down", "not tried"]:
    if not reconnector.tried.is_set():
        return "not tried"
    return "up" if reconnector.error is None else "down"
