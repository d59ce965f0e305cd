"""Warns of addresses that may be reference numbers of a manual: 40001 there is often holding register 0.

Some devices do have such addresses on the wire, as those of SunSpec (from 40000 on) and of SMA (30775): a warning says
both, and there is none where the address before the first reference number is in the profile, or has a point.
"""

from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from typing import Final

from gateway.config.plan.names import device_names, owners, rows_of
from gateway.config.plan.points import places_of, ranges_in
from gateway.config.problem import Path, Problem, warning
from gateway.config.schema.config import Config
from gateway.config.schema.image import Image, Mapped
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.profiles.profile import Range
from gateway.registers.items import MANUAL_BASES

#: How many reference numbers with five digits an area has.
_SPAN: Final = 9999
_FROM_ZERO: Final = "addresses are those on the wire, from 0"


def check_addresses(config: Config) -> Iterator[Problem]:
    """Warn of such addresses of images, mirrors, virtual units, profiles and points."""
    of_profiles = [(profile, _Known(profile)) for profile in config.profile.values()]
    rows = [
        (device_names(owner, row), row, _Known(config.profile.get(row.profile or owner.profile), row.points))
        for owner in owners(config)
        for row in rows_of(owner)
    ]
    of_devices = {name: known for names, _, known in rows for name in names}
    for area in MANUAL_BASES:
        for image in config.image:
            yield from _check_ranges((*image.path, area), area, ranges_in(area, image), _Known(None))
            for polled in image.read:
                known = of_devices.get(image.of or "", _Known(None))
                yield from _check_ranges((*polled.path, area), area, ranges_in(area, polled), known)
            yield from _check_map(image, area, of_devices)
        for profile, known in of_profiles:
            yield from _check_ranges((*profile.path, area), area, ranges_in(area, profile), known)
    yield from _check_points((point, known) for profile, known in of_profiles for point in profile.points)
    yield from _check_points((point, known) for _, row, known in rows for point in row.points)


class _Known:
    """What is known of the addresses of a kind of device: from its profile, and from points."""

    def __init__(self, profile: ProfileTable | None, points: Iterable[PointTable] = ()) -> None:
        self._ranges: list[tuple[Area, Range]] = [place for point in points for place in places_of(point)]
        if profile is not None:
            self._ranges += [(area, each) for area in MANUAL_BASES for each in ranges_in(area, profile)]
            self._ranges += [place for point in profile.points for place in places_of(point)]

    def may_be_reference(self, area: Area, address: int) -> bool:
        """Tell whether an address may be a reference number here."""
        base = MANUAL_BASES.get(area)
        if base is None or not base <= address < base + _SPAN:
            return False
        return not any(first < base <= last + 1 for each, (first, last) in self._ranges if each is area)


def _check_ranges(path: Path, area: Area, ranges: tuple[Range, ...], known: _Known) -> Iterator[Problem]:
    first, last = ranges[0] if ranges else (0, 0)
    base = MANUAL_BASES[area]
    if last < base + _SPAN and known.may_be_reference(area, first):
        yield _warning(path, area, first, f'"{first - base}-{last - base}"')


def _check_map(image: Image, area: Area, of_devices: Mapping[str, _Known]) -> Iterator[Problem]:
    """Warn of the lowest address of a virtual unit, and of each of its devices, that may be a reference number."""
    placed = [(row.at, row) for row in image.map if row.area == area and isinstance(row.at, int)]
    for first, row in [min(placed, key=itemgetter(0))] if placed else []:
        if _Known(None).may_be_reference(area, first):
            here = (
                f"if {first} is a number that counts from {MANUAL_BASES[area]}, write at = {first - MANUAL_BASES[area]}"
            )
            yield warning((*row.path, "at"), _FROM_ZERO, here)
    lowest: dict[str, tuple[Range, Mapped]] = {}
    for row in image.map:
        addresses: Range | None = getattr(row, area)
        if row.device is not None and addresses is not None:
            before = lowest.setdefault(row.device, (addresses, row))
            lowest[row.device] = min(before, (addresses, row), key=itemgetter(0))
    for device, (addresses, row) in lowest.items():
        yield from _check_ranges((*row.path, area), area, (addresses,), of_devices.get(device, _Known(None)))


def _check_points(points: Iterable[tuple[PointTable, _Known]]) -> Iterator[Problem]:
    """Warn of the first point that may have a reference number: where there is one, there are many."""
    found = [
        (point, area, addresses[0])
        for point, known in points
        for area, addresses in places_of(point)
        if known.may_be_reference(area, addresses[0])
    ]
    for point, area, first in found[:1]:
        others = f"; likewise {_count(len(found) - 1)}" if len(found) > 1 else ""
        yield _warning((*point.path, area), area, first, str(first - MANUAL_BASES[area]), others)


def _warning(path: Path, area: Area, first: int, meant: str, others: str = "") -> Problem:
    base = MANUAL_BASES[area]
    here = f"if {first} is a number of a manual that counts from {base}, write {area} = {meant}{others}"
    right = f'if the device has this address, as with SunSpec and SMA, {area} = "{base - 1}-{base - 1 + _SPAN}"'
    return warning(path, _FROM_ZERO, f"{here}; {right} in its profile says so")


def _count(number: int) -> str:
    return "1 more point" if number == 1 else f"{number} more points"
