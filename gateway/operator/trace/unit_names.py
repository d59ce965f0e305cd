"""The names of the units that records are about, and of the sources of their values.

The number in a record is the one that its client used. Through a listener for one line that is an address on the line,
and for other clients this number may be another device; so units are told apart by their names.
"""

from collections.abc import Callable
from typing import Final

from gateway.errors import RequestError
from gateway.modbus.pdu import parse_sent
from gateway.operator.status.virtual_sources import sources_at
from gateway.operator.units.units import find_unit, names
from gateway.runtime.gateway import Gateway
from gateway.trace.records import Answered, Record, Refused, Sent


class UnitNames:
    """The names of the units of a gateway."""

    def __init__(self, gateway: Gateway) -> None:
        self._plan = plan = gateway.plan
        #: The names of the units that every client can reach, by number.
        self.shared: Final = names(plan)
        #: The names of mirrors and virtual units, by their numbers and the devices that they poll.
        self._polling = {(mirror.unit, mirror.of): mirror.name for mirror in plan.mirrors}
        self._polling |= {
            (each.unit.settings.unit, device): each.name for each in gateway.virtual for device in each.pollers
        }
        self._virtual = {driver.name: driver.unit for driver in gateway.virtual}
        #: By the name of a virtual unit and a request: clients repeat theirs.
        self._sources: dict[tuple[str, bytes], tuple[str, ...]] = {}

    def of(self, record: Record) -> str:
        """Return the name of the unit that a record is about; empty if it is about none."""
        if isinstance(record, Sent | Refused):
            return self._polling.get((record.unit, record.name), record.name)
        if isinstance(record, Answered):
            return record.name or self.shared.get(record.unit, "")
        return ""

    def device_of(self, record: Record) -> str:
        """Return the name of the device that was asked for a mirror or virtual unit; empty for any other request."""
        return record.name if isinstance(record, Sent | Refused) and self.of(record) != record.name else ""

    def sources_of(self, record: Record) -> tuple[str, ...]:
        """List the sources of what a client has asked a virtual unit for; none of any other unit."""
        if not isinstance(record, Answered | Refused) or record.name not in self._virtual:
            return ()
        key = record.name, record.request
        if key not in self._sources:
            self._sources[key] = self._sources_of(*key)
        return self._sources[key]

    def is_of(self, wanted: object) -> Callable[[Record], bool]:
        """Make the test whether a record is about the unit with this number or name, through another unit or not.

        A number that is only an address on some line means every record with this number.

        Raises:
            WrongQuestion: nothing has this name, or it is not a unit number.
        """
        number = find_unit(self._plan, wanted)
        name = self.shared.get(number)
        if name is None:
            return lambda record: getattr(record, "unit", None) == number
        return lambda record: name in (self.of(record), self.device_of(record))

    def _sources_of(self, name: str, request: bytes) -> tuple[str, ...]:
        try:
            asked = parse_sent(request)
        except RequestError:
            return ()
        span = asked.read or asked.write
        return () if span is None else sources_at(self._virtual[name], span)
