"""The operation `forget`: a device that changed its address or rate is asked as the config says again."""

from gateway.errors import WrongQuestion
from gateway.events import AddressMoved, BaudChanged, Emit
from gateway.operator.operations.answers.forget import Forgotten
from gateway.operator.operations.asked import OneDevice
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import owner_of
from gateway.operator.units.units import find_unit
from gateway.runtime.gateway import Gateway

_ADVICE = "what was remembered is forgotten, so the config counts again"


async def forget_device(operator: Operator, asked: OneDevice, _asker: Asker) -> Forgotten:
    """Forget the address and the rate of a device; see `forget`."""
    return forget(operator.running.gateway, asked.device, operator.running.emit)


def forget(gateway: Gateway, wanted: object, emit: Emit) -> Forgotten:
    """Forget the remembered address and rate of the device with this name or number.

    Raises:
        WrongQuestion: there is no such device on a line, or its line refuses (see GatewayLine.forget).
    """
    number = find_unit(gateway.plan, wanted)
    line = owner_of(gateway.lines, number)
    if line is None:
        raise WrongQuestion(f"nothing is remembered of {wanted}: it is no device on a line")
    device = line.devices[number]
    was_at, was_baud = device.possible_units, line.driver.line.settings.timing.baud
    line.forget(device)
    unit, baud = device.settings.unit, line.plan.line.timing.baud
    if was_at != (unit,):
        emit(AddressMoved(line.name, device.name, unit, next(iter(was_at), unit), _ADVICE))
    if was_baud != baud:
        emit(BaudChanged(line.name, device.name, baud, _ADVICE))
    return Forgotten(line.name, device.name, unit, was_at, baud, was_baud)
