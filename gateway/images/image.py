from collections.abc import Mapping
from dataclasses import dataclass, field
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile, Range


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """One image: the addresses that exist in each area, and the values they start with (area -> address -> values)."""

    unit: int
    name: str
    profile: Profile
    areas: Mapping[Area, tuple[Range, ...]]
    initial: Mapping[Area, tuple[tuple[int, tuple[int, ...]], ...]] = field(default_factory=dict)
    source: str = ""
