"""Which records of the trace are asked for: by line, unit, client, function and result."""

from collections.abc import Callable
from typing import Final

from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.trace import TracedLine
from gateway.operator.operations.asked import Traced
from gateway.operator.trace.unit_names import UnitNames
from gateway.operator.units.units import find_unit
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.gateway_monitor import GatewayMonitor
from gateway.runtime.gateway_server import GatewayServer
from gateway.runtime.running import Running
from gateway.trace.records import RESULTS, Heard, Incident, Record, Refused, Sent
from gateway.trace.ring import Ring

_OFF: Final = 'nothing is kept: [trace] ring is "0"; set it to "4 MiB", then modbus-gateway reload'


def require_ring(ring: Ring) -> None:
    """Require that records are kept.

    Raises:
        WrongQuestion: they are not.
    """
    if not ring.is_on:
        raise WrongQuestion(_OFF)


def wanted(running: Running, asked: Traced) -> Callable[[Record], bool]:
    """Make the test whether a record is among those that are `asked` for.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    require_ring(running.ring)
    is_there = of_place(running.gateway, asked.line, asked.unit)
    function, client, result = asked.function, asked.client, asked.result
    if result is not None and result not in RESULTS:
        raise WrongQuestion(f'there is no result "{result}"; there are {", ".join(RESULTS)}')

    def is_wanted(record: Record) -> bool:
        return (
            is_there(record)
            and (function is None or record.function == function)
            and (client is None or _is_asked_by(record, client))
            and (result is None or record.has_result(result))
        )

    return is_wanted


def lines(gateway: Gateway) -> tuple[TracedLine, ...]:
    """List the lines and upstreams that facts may name."""
    on_wire = [(each.name, each.plan.line.timing, each.plan.port.port) for each in _serial(gateway)]
    told = [TracedLine(name, timing.mode, port, timing.baud, str(timing.format)) for name, timing, port in on_wire]
    return (*told, *(TracedLine(each.name, "tcp", each.plan.port.port) for each in gateway.upstreams))


def _serial(gateway: Gateway) -> tuple[GatewayLine | GatewayServer | GatewayMonitor, ...]:
    return (*gateway.lines, *gateway.servers, *gateway.monitors)


def of_place(gateway: Gateway, line: object, unit: object) -> Callable[[Record], bool]:
    """Make the test for records of a line, of a unit, or of all if one is None.

    Raises:
        WrongQuestion: there is no such line or unit.
    """
    known = [each.name for each in lines(gateway)]
    if line is not None and line not in known:
        raise WrongQuestion(f'there is no line "{line}"; there are {", ".join(known)}')
    if unit is None:
        return lambda record: line is None or record.line == line
    names = UnitNames(gateway)
    is_his, name = names.is_of(unit), names.shared.get(find_unit(gateway.plan, unit))
    places = {
        (part.name, device.unit) for part in gateway.owners for device in part.devices.values() if device.name == name
    }

    def is_wanted(record: Record) -> bool:
        if line is not None and record.line != line:
            return False
        if isinstance(record, Heard):
            return (record.line, record.frame[0]) in places
        return is_his(record)

    return is_wanted


def _is_asked_by(record: Record, who: str) -> bool:
    """Return whether a client with this name or address asked for it."""
    clients = [getattr(record, "client", ""), *clients_of(record)]
    return any(_is_called(client, who) or who == client.rpartition("@")[2] for client in clients)


def asked_by(who: str) -> Callable[[Record], bool]:
    """Make the test for records of a client with this name or address."""
    return lambda record: any(_is_called(each, who) for each in clients_of(record))


def _is_called(client: str, who: str) -> bool:
    """Return whether a client has this name or address; a poll has all those that want it as its client."""
    return who in (client, client.rpartition(":")[0].strip("[]"), *client.split(", "))


def clients_of(record: Record) -> list[str]:
    """List the clients that asked for it."""
    others = [client for client, _, _ in record.others] if isinstance(record, Incident) else []
    return [record.client, *others] if isinstance(record, Sent | Refused) else others
