"""What was read or written at a point."""

from dataclasses import dataclass
from typing import Any

from gateway.profiles.point import Point
from gateway.registers.datatypes import Value
from gateway.registers.items import has_bits, reference


@dataclass(frozen=True, slots=True)
class Reading:
    """A point and the items of its `read_span`, read or written; `before` are those before a write."""

    point: Point
    items: bytes
    before: bytes | None = None

    @property
    def value(self) -> Value | None:
        """What the items mean; None if they say that there is no value."""
        return self.point.value(self.items)

    @property
    def registers(self) -> list[int]:
        """The registers of the point as numbers; coils and inputs have none."""
        point = self.point
        if has_bits(point.area):
            return []
        own = point.own(self.items)
        return [int.from_bytes(own[at : at + point.width], "big") for at in range(0, len(own), point.width)]

    def as_json(self, *, with_area: bool) -> dict[str, Any]:
        """Make the reading for programs; points of several areas need `with_area`."""
        point = self.point
        named = {"point": point.name} if point.name else {}
        unit = {"unit": point.unit} if point.unit else {}
        before = {} if self.before is None else {"old": point.value(self.before)}
        return {
            **named,
            **({"area": point.area} if with_area else {}),
            "address": point.address,
            "reference": reference(point.area, point.address),
            "value": self.value,
            **before,
            **unit,
            "registers": self.registers,
        }
