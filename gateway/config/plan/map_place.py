"""Where a row of a virtual unit stands: its addresses, or the point of the unit's profile that it is."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from gateway.config.problem import did_you_mean
from gateway.config.schema.image import Image
from gateway.config.schema.mapped import Mapped
from gateway.config.values.ranges import MOST_ITEMS, show_ranges
from gateway.images.polls import polling_function
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, covers


class WrongRow(Exception):  # noqa: N818 - it is a row that is wrong, not the program
    """What is wrong with the value of a key of a row, and what to write instead."""

    def __init__(self, key: str, what: str, remedy: str = "") -> None:
        super().__init__(what)
        self.key = key
        self.remedy = remedy


class RowPlace(NamedTuple):
    """Where a row begins, and the point of the profile that it is, if `at` names one."""

    area: Area
    start: int
    point: Point | None = None

    def check_size(self, count: int, key: str) -> None:
        """Check that so many registers or coils, which are not the value of a point, are as many as the point has here.

        Raises:
            WrongRow: they are not.
        """
        if self.point is not None and self.point.count != count:
            what = f"takes {count}, and point {self.point.name} has {self.point.count}"
            raise WrongRow(key, what, "map as many as it has, or write an address for at")


@dataclass(frozen=True, slots=True)
class MapTarget:
    """The unit whose rows are planned: its table, its profile, and the points that rows may name as their place."""

    image: Image
    profile: Profile
    points: Mapping[str, Point]

    def place_of(self, row: Mapped) -> RowPlace:
        """Find where a row begins.

        Raises:
            WrongRow: the profile has no such point, or it is no whole register.
        """
        if isinstance(row.at, int):
            return RowPlace(Area(row.area), row.at)
        point = self.points.get(row.at)
        if point is not None and point.bits is not None and point.type != "string":
            what = f"{point.name} is a part of register {point.address}, and a row takes whole registers"
            raise WrongRow("at", what, "map that register by its address, or make it one of the unit's own")
        if point is not None:
            return RowPlace(point.area, point.address, point)
        name = self.profile.name
        if not self.points:
            raise WrongRow("at", f"profile {name} has no points", "write an address, such as at = 0")
        remedy = did_you_mean(row.at, self.points) or f"modbus-gateway profile {name} lists its points"
        raise WrongRow("at", f'profile {name} has no point "{row.at}"', remedy)

    def span(self, area: Area, start: int, count: int) -> Span:
        """Make the addresses of a row, or of a part of it.

        Raises:
            WrongRow: there are no such addresses, or the profile does not have them.
        """
        span = Span(area, start, count)
        if span.end > MOST_ITEMS:
            raise WrongRow("at", f"ends at {span.end - 1}, and the last address is {MOST_ITEMS - 1}")
        profile, function = self.profile, polling_function(area)
        if not profile.knows(function):
            what = f"profile {profile.name} has no function {function:d}, which reads {area}"
            raise WrongRow("at", what, "choose another area")
        exist = profile.areas.get(area)
        if not covers(exist, span):
            what = f"profile {profile.name} has no {area} {span.addresses}"
            raise WrongRow("at", what, f"its {area}: {show_ranges(exist or ())}")
        return span

    def initial_int16(self, area: Area, address: int) -> int | None:
        """Find the int16 that a register of the unit's own has at first; None if the config says none."""
        rows = getattr(self.image.initial, area)
        found = [row.values[address - row.at] for row in rows if 0 <= address - row.at < len(row.values)]
        return None if not found else found[0] - 0x10000 if found[0] > 0x7FFF else found[0]
