"""What was read or written at a point, as a value for people and for programs."""

import math
from dataclasses import dataclass
from typing import Any

from gateway.profiles.point import Point
from gateway.registers.datatypes import Value
from gateway.registers.items import has_bits
from gateway.registers.reference import reference


@dataclass(frozen=True, slots=True)
class Reading:
    """A point and the items that were read or written there; `before` are those that were there before a write."""

    point: Point
    items: bytes
    before: bytes | None = None

    @property
    def value(self) -> Value:
        """What the items mean."""
        return self.point.value(self.items)

    @property
    def registers(self) -> list[int]:
        """The registers as numbers; coils and inputs have none."""
        if has_bits(self.point.area):
            return []
        return [int.from_bytes(self.items[at : at + 2], "big") for at in range(0, len(self.items), 2)]

    def as_json(self, *, with_area: bool) -> dict[str, Any]:
        """The reading for programs; points of several areas need `with_area`."""
        point = self.point
        named = {"point": point.name} if point.name else {}
        unit = {"unit": point.unit} if point.unit else {}
        before = {} if self.before is None else {"old": finite(point.value(self.before))}
        return {
            **named,
            **({"area": point.area} if with_area else {}),
            "address": point.address,
            "reference": reference(point.area, point.address),
            "value": finite(self.value),
            **before,
            **unit,
            "registers": self.registers,
        }


def finite(value: Value) -> Value | None:
    """The value in JSON, which has no infinity and no not-a-number: None for these."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
