"""Who may write where from pages."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operator import Operator
from gateway.profiles.point import Point
from gateway.profiles.writing import writes_of
from gateway.registers.items import WRITERS
from gateway.routing.access import right_to
from gateway.web.access.guard import Visitor


@dataclass(frozen=True, slots=True)
class Writable:
    """Where a visitor may write at a unit, if `permits` allows the request; `could`: an operator might write there."""

    areas: tuple[Area, ...]
    could: bool
    permits: Callable[[bytes], bool]

    def takes(self, point: Point) -> bool:
        """Return whether this point can be written."""
        is_possible = point.write != "no" and point.write_span.area in self.areas
        return is_possible and any(map(self.permits, writes_of(point)))

    def as_content(self) -> dict[str, Any]:
        """Return it for templates."""
        return {"writable_areas": self.areas, "operators_may_write": self.could, "can_write": self.takes}


class WriteRights:
    """Rights to write: those of operators, if `[web]` allows writes, within [[access]] and the unit's profile."""

    def __init__(self, operator: Operator, *, may_write: bool) -> None:
        self._operator = operator
        self.may_write = may_write

    def of(self, unit: UnitPicture, visitor: Visitor) -> Writable:
        """Return what this visitor may write."""
        rights, host = self._operator.router("web").rights, visitor.host
        possible = rights.somewhere(host, unit.key)
        if unit.functions is not None:
            possible &= right_to(unit.functions)
        areas = tuple(area for area, functions in WRITERS.items() if not possible.isdisjoint(right_to(functions[:2])))
        is_operator = visitor.role == "operator"
        return Writable(
            areas if self.may_write and is_operator else (),
            self.may_write and bool(areas),
            lambda pdu: rights.permits(host, unit.key, pdu),
        )
