"""Scans of the running gateway's lines: conditions, and the units that are left out."""

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing

from gateway.clock.threads import in_thread
from gateway.config.machine.known_kinds import known_kinds
from gateway.config.problem import WrongValue
from gateway.config.values.unitset import parse_units, show_units
from gateway.errors import PortError, WrongQuestion
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT
from gateway.operator.operations.answers.scan import Progress, ScanStep
from gateway.operator.operations.asked import ToScan
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trace.reader import may_see_all
from gateway.operator.units.units import find_line, may_read_all
from gateway.ports.port import SerialSettings
from gateway.profiles.recognition import KnownKind
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.running import Running
from gateway.tools.scan import Scan, Steps, scan_speeds


async def scan(operator: Operator, asked: ToScan, asker: Asker) -> AsyncGenerator[ScanStep, None]:
    """Scan a line for units that the config does not name, and yield the progress.

    With `all_speeds` the line must not be in use.

    Raises:
        WrongQuestion: the request is invalid, or the line cannot be scanned.
    """
    running = operator.running
    await running.settled()
    line = find_line(running.gateway, asked.line)
    units, known = _units(line, asked.units)
    all_speeds = asked.all_speeds
    check_may_scan(running, asker)
    if line.is_scanned:
        raise WrongQuestion(f"a scan of {line.name} goes on already")
    if all_speeds:
        _check_is_free(running, line, "--all-speeds changes its rate")
        if not isinstance(line.plan.port, SerialSettings):
            raise WrongQuestion(f"the rate of {line.name} is set in its device server")
    elif BROADCAST_UNIT in (*units, *(device.unit for device in line.devices.values())):
        _check_is_free(running, line, "after each question at address 0, or beside it, a late answer is waited for")
    is_answered = _is_answered(line)
    line.is_scanned = True
    try:
        kinds = await _kinds(operator)
        limit = asked.limit_s
        at_all_speeds = all_speeds and _at_all_speeds(running, line, units, limit, kinds)
        async with aclosing(at_all_speeds or Scan(line, units, limit, kinds).run()) as steps:
            async for step in steps:
                if line not in running.gateway.lines:
                    raise WrongQuestion(f"a reload has changed {line.name}: scan it again")
                if isinstance(step, Progress):
                    yield ScanStep(progress=step)
                else:
                    yield ScanStep(found=step, asked=len(units), known=known, is_answered=is_answered)
    except PortError as error:
        raise WrongQuestion(str(error)) from error
    finally:
        line.is_scanned = False


def check_may_scan(running: Running, asker: Asker) -> None:
    """Refuse a scan to who may not read every unit: it asks unknown numbers.

    Raises:
        WrongQuestion: the asker may not.
    """
    is_web = asker.door == "web"
    if not (may_see_all(running, asker.host) if is_web else may_read_all(running)):
        who = "the page" if is_web else "the control socket"
        raise WrongQuestion(f"[[access]] does not give {who} the right to read every unit")


async def _kinds(operator: Operator) -> list[KnownKind]:
    """Read, in a thread, how the kinds of devices are recognised that the gateway's config knows."""
    return await in_thread("read profiles", known_kinds, operator.reloader.file)


async def _at_all_speeds(
    running: Running, line: GatewayLine, units: list[int], limit: float, kinds: Sequence[KnownKind]
) -> Steps:
    async with running.ports.lent(line, "a scan at all speeds") as borrowers:

        def at_rate(baud: int) -> GatewayLine:
            borrower = line.at_speed(baud)
            borrowers.append(borrower.driver.line)
            return borrower

        async with aclosing(scan_speeds(at_rate, units, limit, kinds)) as steps:
            async for step in steps:
                yield step


def _is_answered(line: GatewayLine) -> bool:
    """Tell whether a configured unit has answered since the start, and has not failed since then."""
    return any(
        not device.breaker.failures and any(each.ok or each.exception for each in device.counts.values())
        for device in line.devices.values()
    )


def _units(line: GatewayLine, wanted: object) -> tuple[list[int], str]:
    """Return the units to scan, and as text the rest of the unit set: they are configured or in use."""
    try:
        units = parse_units(f"{FIRST_UNIT}-{LAST_UNIT}" if wanted is None else wanted, first=BROADCAST_UNIT)
    except WrongValue as wrong:
        raise WrongQuestion(f"{wrong}" + (f"; {wrong.remedy}" if wrong.remedy else "")) from wrong
    devices = [device for device in line.devices.values() if device.counts or not line.plan.passes_through]
    taken = {device.unit for device in devices} | {device.settings.unit for device in devices}
    asked = [unit for unit in units if unit not in taken]
    if not asked:
        raise WrongQuestion(f"{show_units(units)} of {line.name}: configured or in use already; status shows how it is")
    known = [] if wanted is None else [unit for unit in units if unit in taken]
    return asked, show_units(known) if known else ""


def _check_is_free(running: Running, line: GatewayLine, why: str) -> None:
    if running.recent.was_asked(line):
        raise WrongQuestion(f"{line.name} is in use: {why}, so no client may have asked in the last minute")
