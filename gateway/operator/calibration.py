"""Measured response times of a device, for an operator who looks for its timing table."""

from collections.abc import Iterator

from gateway.config.plan.forecast import request_for
from gateway.devices.device import Device
from gateway.errors import WrongQuestion
from gateway.modbus.functions import TABLE_FUNCTIONS
from gateway.operator.answers.measured import Measured, MeasuredRow
from gateway.operator.asked import OneUnit
from gateway.operator.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units import find_unit
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.budget import Budget


async def tell_times(operator: Operator, asked: OneUnit, _asker: Asker) -> Measured:
    """Return the response times of a device; see `measured`."""
    return measured(operator.running.gateway, asked.unit)


def measured(gateway: Gateway, wanted: object) -> Measured:
    """Collect the response times of the device with this number or name.

    A number means the device that every client can reach; else the one on the first line where it is an address.

    Raises:
        WrongQuestion: there is none, or it is on no line.
    """
    unit = find_unit(gateway.plan, wanted)
    found = [line for line in gateway.lines if unit in line.devices]
    if found:
        line = min(found, key=lambda each: unit in each.plan.own_units)
        return _measured(line, line.devices[unit])
    called = f"unit {wanted}" if isinstance(wanted, int) else wanted
    raise WrongQuestion(f"{called} is not a device on a line: only those have a timing table")


def _measured(line: GatewayLine, device: Device) -> Measured:
    settings, timing = device.settings, line.driver.line.settings.timing
    return Measured(
        unit=settings.client_unit,
        name=settings.name,
        source=device.source,
        profile=settings.profile.name,
        mode=timing.mode,
        baud=timing.baud,
        format=str(timing.format),
        margin=settings.answer_time.margin,
        timeout_ms=round(settings.answer_time.timeout * 1000, 1),
        rows=tuple(_rows(line, device)),
    )


def _rows(line: GatewayLine, device: Device) -> Iterator[MeasuredRow]:
    budget = Budget(line.driver.line.settings.timing, line.plan.latency)
    for function, times in sorted(device.counts.times.items()):
        if function not in TABLE_FUNCTIONS:
            continue
        for items, row in sorted(times.samples.rows.items()):
            asked = request_for(function, items)
            response = budget.response_wire_time(asked)
            yield MeasuredRow(
                function=function,
                items=items,
                count=row.count,
                times_ms=tuple(round(max(time - response, 0.0) * 1000, 2) for time in row.times),
                longest_ms=round(max(row.longest - response, 0.0) * 1000, 2),
                limit_ms=round(budget.limit(asked, device.answer_time) * 1000, 1),
                allowed_ms=round(device.answer_time.allowed(asked) * 1000, 1),
            )
