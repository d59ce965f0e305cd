"""The rows of access rights."""

from typing import Final

from gateway.config.schema.access import Access
from gateway.config.values.site import Site
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.routing.access import NOTHING, READING, WRITING, AccessRow, Network, Right, right_to

_RIGHTS: Final = {"read": READING, "write": WRITING}


def access_row(row: Access) -> AccessRow:
    """Turn a row of `[[access]]` into a row of rights."""
    return AccessRow(
        right=_right(row),
        networks=None if row.networks is None else networks_of(row),
        listeners=None if row.listen is None else frozenset(row.listen),
        units=None if row.units == "all" else frozenset(row.units),
        role=row.role,
        source=row.place,
        sites=frozenset(sites_of(row)),
        addresses=addresses_of(row),
        priority=row.priority,
    )


def networks_of(row: Access) -> tuple[Network, ...]:
    """List what `from` names, without sites."""
    return tuple(each for each in row.networks or () if not isinstance(each, Site))


def sites_of(row: Access) -> tuple[str, ...]:
    """List the sites that `from` names."""
    return tuple(each.name for each in row.networks or () if isinstance(each, Site))


def addresses_of(row: Access) -> tuple[Span, ...] | None:
    """List the addresses that a row is for; None if it has no such key, so that it is for all."""
    areas = ((area, getattr(row, area)) for area in Area)
    named = [(area, ranges) for area, ranges in areas if ranges is not None]
    spans = tuple(Span(area, first, last - first + 1) for area, ranges in named for first, last in ranges)
    return spans if named else None


def _right(row: Access) -> Right:
    if row.functions is not None:
        return right_to(row.functions)
    return NOTHING.union(*(_RIGHTS[name] for name in row.allow or ()))
