"""What one read of a device may take: so many items, and over which gaps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Self

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Profile, Range, covers
from gateway.registers.items import MOST_WIDE, REGISTER


@dataclass(frozen=True, slots=True)
class ReadRules:
    """The rules for the reads of a device.

    `limits` is the most items for a function. A read may include up to `max_gap` addresses in a row that nobody asked
    for, if they exist and are not `only_written`. `areas` are the addresses that exist; an area that is not named has
    all.
    """

    limits: Mapping[int, int] = field(default_factory=dict)
    max_gap: int = 0
    areas: Mapping[Area, tuple[Range, ...]] = field(default_factory=dict)
    only_written: tuple[Span, ...] = ()

    @classmethod
    def of(cls, profile: Profile) -> Self:
        """Make the rules of a profile. Nothing is bridged where registers have different widths."""
        return cls(profile.limits, 0 if profile.wide else profile.max_gap, profile.areas, profile.only_written)

    def most(self, area: Area, width: int = REGISTER) -> int:
        """Return the most items of an area, registers of `width` bytes, that one request reads."""
        function, most = READERS[area]
        if width > REGISTER:
            most = MOST_WIDE
        return min(most, self.limits.get(function, most))

    def allows(self, hole: Span) -> bool:
        """Tell whether a read may include these addresses, which nobody asked for."""
        if hole.count > self.max_gap or not covers(self.areas.get(hole.area), hole):
            return False
        return not any(each.touches(hole) for each in self.only_written)


#: The rules of a device of which nothing is known.
NO_RULES: Final = ReadRules()
