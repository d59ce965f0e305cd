"""The verb `doctor`: reads units with too little evidence, and finds the faults of the lines.

`tools/outside.py` examines ports without opening them; the caller joins both.
"""

import asyncio
import time
from collections.abc import Iterable, Iterator
from typing import Final

from gateway.clock.slices import in_slices, turn
from gateway.config.reading.source import place_of
from gateway.devices.device import Device
from gateway.diagnosis.clients import about_client
from gateway.diagnosis.evidence import LineEvidence, PortInUse, Search
from gateway.diagnosis.finding import IS_DOWN, Finding
from gateway.diagnosis.images import about_polled
from gateway.diagnosis.last import RECENT
from gateway.diagnosis.lines import about_line, against_loss
from gateway.diagnosis.monitors import about_monitor
from gateway.diagnosis.state import about_state_file
from gateway.diagnosis.units import ENOUGH as ENOUGH_IN_A_ROW
from gateway.diagnosis.units import about_unit
from gateway.errors import WrongQuestion
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.operator.operations.answers.doctor import Examination
from gateway.operator.operations.asked import ToExamine
from gateway.operator.operations.operation import Asker, IsThere
from gateway.operator.operator import Operator
from gateway.operator.status.troubles import REJECTED
from gateway.operator.units.units import may_read_all, no_such_line
from gateway.ports.port import SerialSettings, SiteSettings
from gateway.readconfig.expiry import about_certificates
from gateway.runtime.gateway import Owner, Part
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.gateway_upstream import GatewayUpstream
from gateway.runtime.running import Running
from gateway.timing.measured import NEVER
from gateway.tools.evidence import (
    client_evidence,
    line_evidence,
    monitor_evidence,
    pauses_before,
    polled_evidence,
    records_of,
    shown_devices,
    unit_evidence,
    units_evidence,
    upstream_evidence,
)
from gateway.tools.questions import harmless_read, outcome_of
from gateway.tools.search import search

#: How long an examination waits for another one to end, in seconds.
_TURN: Final = 60.0

#: A unit is read until it has this many requests, or until it has failed to answer this often.
SAMPLES: Final = 4
FAILURES: Final = 2
#: How long all reads of a line may take, and how long to wait for late answers at least and at most, in seconds.
LONGEST_ASKING: Final = 30.0
SHORTEST_WINDOW: Final = 2.0
LONGEST_WINDOW: Final = 5.0
_STEP: Final = 0.05
#: Listening time for a line with few samples, in seconds.
LISTENING: Final = 3.0


async def examine(operator: Operator, asked: ToExamine, asker: Asker) -> Examination:
    """Examine one line or upstream, or all of them, after any other examination.

    Raises:
        WrongQuestion: there is no such line, or another examination does not end.
    """
    running = operator.running
    await running.settled()
    try:
        async with asyncio.timeout(_TURN):
            await running.examining.acquire()
    except TimeoutError:
        raise WrongQuestion(f"another examination has not ended within {_TURN:.0f} s: try again later") from None
    try:
        groups, ports = await examined(running, asked.line, asker.is_there, asks=asked.ask)
    finally:
        running.examining.release()
    findings = [finding for _, findings in groups for finding in findings]
    if not (findings or running.gateway.parts):
        findings = [Finding("ok", "gateway", "runs; it has no lines and no upstreams")]
    return Examination(tuple(findings), tuple(ports))


async def examined(
    running: Running, wanted: object, is_there: IsThere, *, asks: bool
) -> tuple[list[tuple[str, list[Finding]]], list[PortInUse]]:
    """Find faults by line, and under an empty name those of all else; also return the serial ports.

    `asks`: units with too little evidence are read first.

    Raises:
        WrongQuestion: there is no such line.
    """
    gateway = running.gateway
    parts = [part for part in gateway.parts if wanted in (None, part.name)]
    if wanted is not None and not parts:
        raise no_such_line(wanted, [part.name for part in gateway.parts])
    if asks:
        found_about = await asyncio.gather(*(_about(running, part, is_there, asks=True) for part in parts))
    else:  # in turn, each with pauses
        found_about = [await _about(running, part, is_there, asks=False) for part in parts]
    groups = [(part.name, found) for part, found in zip(parts, found_about, strict=True)]
    if wanted is None:
        polled = await polled_evidence(gateway)
        beside = [finding for each in polled for finding in about_polled(each)]
        beside += [finding for each in running.add_ons for finding in each.findings()]
        beside += [*_about_config(running), *_about_state(running), *_about_page(running)]
        groups.append(("", [*about_certificates(running.contexts, time.time()), *beside]))
    listeners = [each for each in gateway.listeners if wanted is None or each.settings.only in ("", wanted)]
    now = asyncio.get_running_loop().time()
    clients = [client for listener in listeners for client in client_evidence(listener, gateway, now)]
    groups.append(("", [finding for client in clients for finding in about_client(client)]))
    return groups, [each for part in parts for each in _port_of(part)]


def _about_state(running: Running) -> Iterator[Finding]:
    for each in () if running.troubles is None else running.troubles.status():
        yield about_state_file(each.file, each.reason, was_damaged=each.state == "damaged")


def _about_config(running: Running) -> Iterator[Finding]:
    if not running.reload_succeeded:
        yield Finding("fix", "config", REJECTED, "modbus-gateway check FILE says why; then modbus-gateway reload")


def _about_page(running: Running) -> Iterator[Finding]:
    if running.page_trouble:
        yield Finding("fix", "web", running.page_trouble, "correct [web] in the config, then restart the gateway")


async def _about(running: Running, part: Part, is_there: IsThere, *, asks: bool) -> list[Finding]:
    if isinstance(part, GatewayServer):
        return _about_server(part)
    if isinstance(part, GatewayUpstream):
        return await _about_upstream(running, part, is_there, asks=asks)
    if isinstance(part, GatewayMonitor):
        return await _about_monitor(running, part, waits=asks)
    line, now = part, asyncio.get_running_loop().time
    began, found, said = now(), None, []
    if asks and line.reconnector.is_open:
        asked, is_cut_short = await _ask_units(running, line, is_there)
        if asked:
            await asyncio.sleep(max(0.0, began + LISTENING - now()))  # other clients may ask now and then
            said.append(_told_of_reads(asked, is_cut_short=is_cut_short))
        found = await _look_for_silent_units(running, line, is_there)
        if found is not None:
            said += _told(found)
    units = await units_evidence(line)
    records = [] if isinstance(line.plan.port, SerialSettings) else await records_of(line, running.ring)
    await turn()
    findings = await _about_evidence(line_evidence(line, now(), running.recent, units, records, found))
    if said:
        findings.append(_has_sent(line, said))
    return findings


async def _about_evidence(line: LineEvidence) -> list[Finding]:
    """Find the faults of a line or an upstream, with pauses for the lines."""
    about_units = await in_slices(tuple(about_unit(unit, line)) for unit in line.units)
    await turn()
    return list(about_line(line, about_units))


async def _about_monitor(running: Running, monitor: GatewayMonitor, *, waits: bool) -> list[Finding]:
    """Find why little is heard; if nothing was heard yet and it `waits`, LISTENING seconds later."""
    if waits and monitor.reconnector.is_open and not monitor.sent:
        await asyncio.sleep(LISTENING)
    records = [] if isinstance(monitor.plan.port, SerialSettings) else await records_of(monitor, running.ring)
    now = asyncio.get_running_loop().time()
    return list(about_monitor(monitor_evidence(monitor, now, running.recent, records)))


async def _about_upstream(
    running: Running, upstream: GatewayUpstream, is_there: IsThere, *, asks: bool
) -> list[Finding]:
    if upstream.reconnector.error is not None:
        return list(_why_down(running, upstream))
    asked, is_cut_short = await _ask_units(running, upstream, is_there) if asks else (0, False)
    units, now = await units_evidence(upstream), asyncio.get_running_loop().time()
    records = await records_of(upstream, running.ring)
    pauses = await pauses_before(records, units)
    findings = await _about_evidence(upstream_evidence(upstream, now, running.recent, units, records, pauses))
    if asked:
        findings.append(_has_sent(upstream, [_told_of_reads(asked, is_cut_short=is_cut_short)]))
    return findings


def _told_of_reads(asked: int, *, is_cut_short: bool) -> str:
    limit = f" in {LONGEST_ASKING:g} s, which was too short for all" if is_cut_short else ""
    return ("one read of a configured unit" if asked == 1 else f"{asked} reads of configured units") + limit


def _has_sent(part: Owner, said: list[str]) -> Finding:
    return Finding("note", part.name, f"doctor has sent {', and '.join(said)}")


async def _ask_units(running: Running, part: Owner, is_there: IsThere) -> tuple[int, bool]:
    """Read units with too little evidence. Return the number of requests, and whether LONGEST_ASKING cut it short."""

    def is_wanted() -> bool:
        return is_there() and running.ports.keeps(part)

    asked = 0
    try:
        async with asyncio.timeout(LONGEST_ASKING):
            for device in _doubtful_first(part):
                settings, before = device.settings, asked
                pdu = harmless_read(settings.profile)
                await turn()  # a line may have hundreds
                while pdu is not None and is_wanted() and _needs_more(part, device, asked - before):
                    error, _ = await outcome_of(running.routers.control, settings.known_as, pdu, is_there)
                    if error is not None and not _was_sent(error.result):
                        break  # it rests, or the operator may not read
                    asked += 1
                    if error is not None and isinstance(part, GatewayLine):
                        await _wait_for_late_answer(part)
                    await turn()  # the responses of many lines come at once
    except TimeoutError:
        return asked, True
    return asked, False


def _doubtful_first(part: Owner) -> list[Device]:
    """Return the units to read, failing ones first: then later answers prove that the line still works."""
    named = part.plan.shared if isinstance(part, GatewayLine) else part.plan.devices
    names = {settings.name for settings in named}
    return sorted((device for device in shown_devices(part) if device.name in names), key=_has_answered)


def _has_answered(device: Device) -> bool:
    times = device.counts.times.values()
    return not device.breaker.failures and any(each.answered_at != NEVER for each in times)


async def _wait_for_late_answer(line: GatewayLine) -> None:
    """Wait for the end of the late windows, and at least SHORTEST_WINDOW: some answers come even later."""
    now = asyncio.get_running_loop().time
    until = now() + LONGEST_WINDOW
    await asyncio.sleep(SHORTEST_WINDOW)
    while line.driver.line.ledger.count_late(now()) and now() < until:  # noqa: ASYNC110 - no event tells the end
        await asyncio.sleep(_STEP)


async def _look_for_silent_units(running: Running, line: GatewayLine, is_there: IsThere) -> Search | None:
    known = await in_slices((device, unit_evidence(line, device)) for device in shown_devices(line))
    silent = [device for device, unit in known if unit.is_silent and device.unit != BROADCAST_UNIT]
    if not silent or not _may_be_searched(running, line):
        return None
    overheard = line.driver.line.attribution.overheard
    is_dead = all(unit.is_silent for _, unit in known if unit.asked) and not overheard.requests
    return await search(running, line, silent, is_dead=is_dead, asked_by=is_there)


def _may_be_searched(running: Running, line: GatewayLine) -> bool:
    """Tell whether other addresses may be read; not if a late response could pass for one to address 0."""
    answers_from_any = any(device.unit == BROADCAST_UNIT for device in line.devices.values())
    return may_read_all(running) and not (line.plan.passes_through or answers_from_any)


def _told(found: Search) -> list[str]:
    told = []
    if found.addresses:
        told.append(f"one read to each of the addresses {', '.join(map(str, sorted(found.addresses)))}")
    if found.speeds:
        told.append(f"reads at {found.speeds} other rates and formats")
    return told


def _needs_more(part: Owner, device: Device, asked_here: int) -> bool:
    unit = unit_evidence(part, device)
    if unit.answered and unit.in_a_row:  # did it lose a few requests, does it answer again?
        return not asked_here or max(unit.in_a_row, asked_here) < ENOUGH_IN_A_ROW
    if unit.ago is not None and unit.ago > min(RECENT, _failed_ago(part)):
        return asked_here < ENOUGH_IN_A_ROW
    if unit.bad_frames and not unit.answered:  # are two devices there, or is the line disturbed?
        return asked_here < SAMPLES
    return unit.asked < SAMPLES and unit.timeouts < FAILURES and not unit.late


def _failed_ago(part: Owner) -> float:
    """Return the seconds since the last failure of a unit that has not answered since; infinite if there is none."""
    failing = (device.counts.last_error_at for device in part.all_devices if device.breaker.failures)
    return part.now() - max(failing, default=NEVER)


def _was_sent(result: str) -> bool:
    return result in ("timeout", "bad_frame", "ambiguous", "exception")


def _about_server(server: GatewayServer) -> list[Finding]:
    programs, error = server.programs, server.reconnector.error
    if error is not None:
        remedy = f"see the rows about the port of {server.name}" if programs is None else ""
        return [Finding("fix", server.name, f"{IS_DOWN}{error}", remedy)]
    said = f"responses to its client: {server.driver.counts.responses}"
    if programs is not None:
        using = {0: "no program uses", 1: "one program uses"}.get(programs, f"{programs} programs use")
        said = f"{using} {server.port}; {said}"
    return [Finding("ok", server.name, said)]


def _why_down(running: Running, upstream: GatewayUpstream) -> Iterable[Finding]:
    port, error = upstream.plan.port, upstream.reconnector.error
    if isinstance(port, SiteSettings):
        return running.add_ons.fleet.findings_about_upstream(upstream.name, port.site, error)
    place = place_of(upstream.plan.upstream.source, "to")
    otherwise = f'{place}: check to = "{upstream.reconnector.port_path}", and the server there'
    remedy = against_loss(str(error), otherwise)
    return [Finding("fix", upstream.name, f"is down: {error}", remedy)]


def _port_of(part: Part) -> list[PortInUse]:
    if isinstance(part, GatewayUpstream) or not isinstance(part.plan.port, SerialSettings):
        return []
    is_standby = isinstance(part, GatewayLine) and part.is_standby
    place = place_of(part.plan.line.source, "port")
    return [PortInUse(part.name, place, part.plan.port.port, part.reconnector.is_open, is_standby)]
