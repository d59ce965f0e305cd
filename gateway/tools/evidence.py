"""Evidence about lines, units and clients for the rules of `diagnosis`, taken from the counters."""

import asyncio
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gateway.clock.slices import in_slices, turn
from gateway.devices.device import Device
from gateway.diagnosis.evidence import (
    ClientEvidence,
    HeardUnitEvidence,
    LineEvidence,
    MonitorEvidence,
    PolledEvidence,
    Search,
    SourceEvidence,
    UnitEvidence,
)
from gateway.diagnosis.last import NOW, RECENT, Last
from gateway.diagnosis.lines import is_closed_at_once
from gateway.diagnosis.pauses import NO_PAUSES, Pauses, pauses_of, situations
from gateway.images.mirror import Mirror
from gateway.images.virtual.unit import VirtualUnit
from gateway.lines.counts import Belated, Overheard, UnitCounts, total
from gateway.listeners.tcp import TcpListener
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.operator.status.unit_status import oldest
from gateway.operator.status.virtual_sources import source_states
from gateway.ports.port import SerialSettings
from gateway.runtime.gateway import Gateway, Listener, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.recent import Recent
from gateway.timing.histogram import SHARES, merged
from gateway.timing.measured import NEVER
from gateway.trace.records import PortChanged, Record, Sent
from gateway.trace.ring import STEP, Ring

#: The most records of the trace that are looked at, and kept of a line or upstream.
_LOOKED_AT: Final = 4000
_KEPT: Final = 1000


async def units_evidence(part: Owner) -> tuple[UnitEvidence, ...]:
    """Gather the evidence about the units of a line or an upstream, with pauses for other work."""
    return tuple(await in_slices(unit_evidence(part, device) for device in shown_devices(part)))


async def records_of(owner: Owner, ring: Ring) -> list[Record]:
    """Find the last records about a line or upstream in the trace, with pauses for other work."""
    number, kept = max(ring.first, ring.added - _LOOKED_AT), deque[Record](maxlen=_KEPT)
    while records := ring.after(number, STEP):
        kept += [each for each in records if each.line == owner.name]
        number += len(records)
        await turn()
    return list(kept)


async def pauses_before(records: Sequence[Record], units: Sequence[UnitEvidence]) -> Pauses:
    """Find how requests to an upstream fared by what was before them, if some got no response, and no late one."""
    if sum(unit.timeouts for unit in units) <= 2 * sum(unit.late for unit in units):
        return NO_PAUSES
    return pauses_of(await in_slices(situations(each for each in records if isinstance(each, Sent))))


def upstream_evidence(
    upstream: GatewayUpstream,
    now: float,
    recent: Recent,
    units: tuple[UnitEvidence, ...],
    records: Sequence[Record],
    pauses: Pauses,
) -> LineEvidence:
    """Gather the evidence about an upstream that is up, including its `units` and the last `records` about it."""
    settings, rate = upstream.plan.upstream, recent.rate(upstream, now)
    return LineEvidence(
        settings.name,
        settings.source,
        0,
        "",
        **_losses(records, now),
        is_serial=False,
        busy_share=None if rate is None else rate.busy,
        units=units,
        in_flight=settings.in_flight,
        pauses=pauses,
        takes_zero=settings.transaction_id == "zero",
    )


def _losses(records: Sequence[Record], now: float) -> dict[str, Any]:
    """Find how often a connection was lost in the last minute, and the reason that says most, or else the last one."""
    ports = [each for each in records if isinstance(each, PortChanged)]
    reasons = [each.reason for each in ports if each.reason and each.at >= now - RECENT]
    telling = [*filter(is_closed_at_once, reasons)] or reasons
    return {"losses": len(reasons), "loss": telling[-1] if telling else ""}


def line_evidence(
    line: GatewayLine,
    now: float,
    recent: Recent,
    units: tuple[UnitEvidence, ...],
    records: Sequence[Record],
    found: Search | None = None,
) -> LineEvidence:
    """Gather the evidence about a line, including its `units`; `found` is the result of a search there."""
    machine, plan = line.driver.line, line.plan
    timing, overheard = machine.settings.timing, machine.attribution.overheard
    rate = recent.rate(line, now)
    return LineEvidence(
        name=line.name,
        source=plan.line.source,
        baud=timing.baud,
        format=str(timing.format),
        reason=str(line.reconnector.error or ""),
        **_losses(records, now),
        is_standby=line.is_standby,
        is_serial=isinstance(plan.port, SerialSettings),
        echo=machine.settings.echo,
        busy_share=None if rate is None else rate.busy,
        sent=line.sent,
        copies=overheard.copies,
        copies_in_a_row=machine.attribution.echoes_in_a_row,
        last_copy=Last(now - overheard.copied_at, overheard.sent_since_copy),
        others=overheard.requests,
        last_other=Last(now - overheard.requested_at, overheard.sent_since_request),
        errors=line.driver.errors,
        last_parity=recent.last_wrong(line, "parity", now),
        last_framing=recent.last_wrong(line, "framing", now),
        units=units,
        search=found,
    )


def shown_devices(part: Owner) -> list[Device]:
    """Select the devices to show: all that the config names, and others that got requests."""
    return [device for device in part.all_devices if device.counts or _is_configured(part, device)]


def _is_configured(part: Owner, device: Device) -> bool:
    """Tell whether the config names the device."""
    if isinstance(part, GatewayMonitor):
        return True
    if isinstance(part, GatewayLine):
        return not part.plan.passes_through
    return part.unnamed.get(device.settings.unit) is not device


def unit_evidence(part: Owner, device: Device) -> UnitEvidence:
    """Gather the evidence about a device of a line or an upstream."""
    settings, counts = device.settings, device.counts
    whole = total(counts.values())
    times = tuple(counts.times[function] for function in counts)
    late = sum(each.late for each in times)
    overheard = part.driver.line.attribution.overheard if isinstance(part, GatewayLine) else Overheard()
    belated = overheard.belated.get(device.unit, Belated())
    slowest = [(each.latest, each.latest_limit) for each in times]
    latest, latest_limit = max([(belated.longest, belated.limit), *slowest])
    answered_at = max((each.answered_at for each in times), default=NEVER)
    return UnitEvidence(
        unit=settings.client_unit,
        on_the_wire=device.unit,
        name=settings.name,
        source=device.source,
        profile=settings.profile.name,
        answered=whole.ok + whole.exception,
        exceptions=whole.exception,
        timeouts=whole.timeout,
        bad_frames=whole.bad_frame,
        ambiguous=whole.ambiguous,
        late=late + belated.count,
        latest=latest,
        latest_limit=latest_limit,
        behind=whole.late_responses - late,
        limit=max((each.limit for each in times), default=0.0),
        limit_share=merged(SHARES, (each.share for each in times)).quantile(0.99),
        twice=overheard.second_responses.get(device.unit, 0),
        instead=counts.received_instead,
        explained=whole.explained,
        why=counts.why,
        in_a_row=device.breaker.failures,
        ago=None if answered_at == NEVER else part.now() - answered_at,
        is_configured=_is_configured(part, device),
        has_table=device.answer_time.has_table,
        moved_from=device.moved_from,
        last_failed=_last(counts, part.now(), "timeout", "bad_frame", "ambiguous"),
        last_bad=_last(counts, part.now(), "bad_frame"),
        last_late=_last(counts, part.now(), "late"),
        last_twice=_last(counts, part.now(), "twice"),
    )


def _last(counts: UnitCounts, now: float, *what: str) -> Last:
    """Return the last time of any of these results; NOW if unknown."""
    found = [counts.last_times[each] for each in what if each in counts.last_times]
    if not found:
        return NOW
    last = max(found)
    return Last(now - last.at, counts.responses - last.responses)


def monitor_evidence(monitor: GatewayMonitor, now: float, recent: Recent, records: Sequence[Record]) -> MonitorEvidence:
    """Gather the evidence about a line that only listens; `records` are the last ones about it."""
    counts, timing = monitor.driver.monitor.counts, monitor.plan.line.timing
    return MonitorEvidence(
        name=monitor.name,
        mode=timing.mode,
        on_port=LineEvidence(
            name=monitor.name,
            source=monitor.plan.line.source,
            baud=timing.baud,
            format=str(timing.format),
            reason=str(monitor.reconnector.error or ""),
            **_losses(records, now),
            is_serial=isinstance(monitor.plan.port, SerialSettings),
            errors=monitor.driver.errors,
            last_parity=recent.last_wrong(monitor, "parity", now),
            last_framing=recent.last_wrong(monitor, "framing", now),
        ),
        requests=counts.requests,
        answers=counts.answers,
        sure=counts.sure,
        strays=counts.strays,
        noise=counts.noise,
        ago=None if monitor.heard_at == NEVER else now - monitor.heard_at,
        units=tuple(map(_heard_unit, monitor.all_devices)),
        unknown_units=tuple(monitor.unknown_units()),
        asks_units=any(unit != BROADCAST_UNIT for unit in counts.requests_to),
    )


def _heard_unit(device: Device) -> HeardUnitEvidence:
    counts = total(device.counts.values())
    return HeardUnitEvidence(device.name, device.unit, counts.sent, counts.sent - counts.timeout)


async def polled_evidence(gateway: Gateway) -> list[PolledEvidence]:
    """Gather the evidence about mirrors and virtual units, with pauses for the lines."""
    lines = {device.name: owner for owner in gateway.owners for device in owner.all_devices}
    found = []
    for driver in gateway.polling_units:
        unit, now = driver.unit, asyncio.get_running_loop().time()
        told = tuple(await in_slices(_sources(unit, lines, now)))
        found.append(PolledEvidence(unit.name, unit.label, unit.settings.stale, told))
    return found


def _sources(unit: Mirror | VirtualUnit, lines: Mapping[str, Owner], now: float) -> Iterator[SourceEvidence]:
    """Gather the evidence about sources. One that is only heard is lost if it never was: a write may come between."""
    if isinstance(unit, VirtualUnit):
        for each in source_states(unit, now):
            line = lines.get(each.device)
            is_heard = isinstance(line, GatewayMonitor)
            name, is_lost = "" if line is None else line.name, each.since is None if is_heard else each.is_lost
            yield SourceEvidence(each.device, name, each.since, is_lost, each.invalid, each.refused, is_heard)
        return
    of, parts = unit.settings.of, unit.parts
    since = oldest(None if part.sampled_at is None else now - part.sampled_at for part in parts)
    line = lines[of]
    is_heard = isinstance(line, GatewayMonitor)
    is_lost = since is None if is_heard else any(part.age(now) is None and not part.is_awaited for part in parts)
    yield SourceEvidence(of, line.name, since, is_lost, is_heard=is_heard)


def client_evidence(listener: Listener, gateway: Gateway, now: float) -> list[ClientEvidence]:
    """Gather the evidence about clients of a listener that left before their response."""
    if not isinstance(listener, TcpListener):
        return []
    own = listener.settings.only
    waits = [wait for part in gateway.owners if own in ("", part.name) for wait in part.longest_wait.values()]
    longest = max(waits, default=0.0)
    return [
        ClientEvidence(host, listener.settings.name, each.count, each.waited, longest, Last(now - each.at))
        for host, each in listener.counts.departures.items()
    ]
