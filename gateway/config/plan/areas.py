"""What the tables of images, mirrors and profiles say of each of the four areas."""

from typing import Final

from gateway.config.schema.image import Image, InitialValues, Polled
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.profiles.profile import Range

#: The areas, each with its key as plain text, which is found quicker.
_KEYS: Final = tuple((area, area.value) for area in Area)


def ranges_in(area: Area, table: Image | Polled | ProfileTable) -> tuple[Range, ...]:
    """List the addresses that a table names in an area; empty if it has no key for it."""
    ranges: tuple[Range, ...] | None = getattr(table, area)
    return ranges or ()


def initial_values(area: Area, image: Image) -> tuple[InitialValues, ...]:
    """List the initial values of an area."""
    rows: tuple[InitialValues, ...] = getattr(image.initial, area)
    return rows


def places_of(point: PointTable) -> tuple[tuple[Area, Range], ...]:
    """List the areas of a point, with its addresses there; a table that has passed its checks has one."""
    return tuple((area, found) for area, key in _KEYS if (found := getattr(point, key)) is not None)
