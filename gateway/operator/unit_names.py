"""The names of the units that records are about.

The number in a record is the one that its client used. Through a listener for one line that is an address on the line,
and for other clients this number may be another device; so units are told apart by their names.
"""

from collections.abc import Callable
from typing import Final

from gateway.config.plan.settings import Plan
from gateway.operator.units import find_unit, names
from gateway.trace.records import Answered, Record, Refused, Sent


class UnitNames:
    """The names of the units of a plan."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        #: The names of the units that every client can reach, by number.
        self.shared: Final = names(plan)
        #: The names of mirrors, by their numbers and the devices that they poll.
        self._mirrors = {(mirror.unit, mirror.of): mirror.name for mirror in plan.mirrors}

    def of(self, record: Record) -> str:
        """Return the name of the unit that a record is about; empty if it is about none."""
        if isinstance(record, Sent | Refused):
            return self._mirrors.get((record.unit, record.name), record.name)
        if isinstance(record, Answered):
            return record.name or self.shared.get(record.unit, "")
        return ""

    def is_of(self, wanted: object) -> Callable[[Record], bool]:
        """Make the test whether a record is about the unit with this number or name.

        A number that is only an address on some line means every record with this number.

        Raises:
            WrongQuestion: nothing has this name, or it is not a unit number.
        """
        number = find_unit(self._plan, wanted)
        name = self.shared.get(number)
        if name is None:
            return lambda record: getattr(record, "unit", None) == number
        return lambda record: self.of(record) == name
