"""Measured response times of a device, for an operator who looks for its timing table."""

from collections.abc import Iterator

from gateway.config.plan.forecast import request_for
from gateway.devices.device import Device
from gateway.errors import WrongQuestion
from gateway.modbus.functions import TABLE_FUNCTIONS
from gateway.operator.operations.answers.times import Measured, MeasuredRow
from gateway.operator.operations.asked import OneUnit
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import owner_of
from gateway.operator.units.units import find_unit
from gateway.runtime.gateway import Gateway, Owner
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.timing.budget import Budget, ServerBudget


async def tell_times(operator: Operator, asked: OneUnit, _asker: Asker) -> Measured:
    """Return the response times of a device; see `measured`."""
    return measured(operator.running.gateway, asked.unit)


def measured(gateway: Gateway, wanted: object) -> Measured:
    """Collect the response times of the device with this number or name.

    A number means the device that every client can reach; else the one on the first line where it is an address.

    Raises:
        WrongQuestion: there is none, or the gateway answers it itself.
    """
    unit = find_unit(gateway.plan, wanted)
    owner = owner_of(gateway.owners, unit)
    if owner is None:
        raise WrongQuestion(f"the gateway answers unit {unit} itself: only devices have a timing table")
    return _measured(owner, owner.devices[unit])


def _measured(owner: Owner, device: Device) -> Measured:
    settings, timing = device.settings, None
    if isinstance(owner, GatewayLine):
        timing = owner.driver.line.settings.timing
    elif isinstance(owner, GatewayMonitor):
        timing = owner.plan.line.timing
    return Measured(
        unit=settings.client_unit,
        name=settings.name,
        source=device.source,
        profile=settings.profile.name,
        mode="tcp" if timing is None else timing.mode,
        baud=0 if timing is None else timing.baud,
        format="" if timing is None else str(timing.format),
        margin=settings.answer_time.margin,
        timeout_ms=round(settings.answer_time.timeout * 1000, 1),
        rows=tuple(_rows(device, owner.budget)),
    )


def _rows(device: Device, budget: Budget | ServerBudget) -> Iterator[MeasuredRow]:
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
