"""What was read or written at a point."""

from dataclasses import dataclass, replace
from typing import Any

from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.registers.datatypes import Value
from gateway.registers.items import has_bits, reference


@dataclass(frozen=True, slots=True)
class Reading:
    """A point and the items of its `read_span`; `before` are those before a write.

    If it `is_written`, the items were not read: the other bits of a register and the gap before a scale are not known.
    """

    point: Point
    items: bytes
    before: bytes | None = None
    is_written: bool = False

    @property
    def value(self) -> Value | None:
        """What the items mean; None if they say that there is no value."""
        point = replace(self.point, invalid=()) if self.is_written else self.point
        return point.value(self.items)

    @property
    def text(self) -> str:
        """The value as text, without its unit."""
        return self.point.show(self.value)

    @property
    def place(self) -> Span:
        """Where it was read or written."""
        return self.point.write_span if self.is_written else self.point.span

    @property
    def registers(self) -> list[int]:
        """The registers of the point as numbers, if all of their bits are known; coils and inputs have none."""
        point = self.point
        if has_bits(point.area) or (self.is_written and point.bits is not None):
            return []
        own = point.own(self.items)
        return [int.from_bytes(own[at : at + point.width], "big") for at in range(0, len(own), point.width)]

    def as_json(self, *, with_area: bool) -> dict[str, Any]:
        """Make the reading for programs; points of several areas need `with_area`."""
        point, place = self.point, self.place
        named = {"point": point.name} if point.name else {}
        unit = {"unit": point.unit} if point.unit else {}
        before = {} if self.before is None else {"old": point.value(self.before)}
        return {
            **named,
            **({"area": place.area} if with_area else {}),
            "address": place.start,
            "reference": reference(place.area, place.start),
            **({} if point.bits is None else {"bits": point.bits}),
            "value": self.value,
            **before,
            **unit,
            "registers": self.registers,
        }
