"""How a virtual unit has the values of its sources."""

from collections.abc import Iterator, Sequence
from math import inf
from typing import NamedTuple

from gateway.images.virtual.row import Row
from gateway.images.virtual.settings import FreshBits, SourceAge
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.pdu import Span


class SourceState(NamedTuple):
    """A device, or an image, of which a virtual unit has `rows`; so many of them are `fresh`.

    `age` is that of the oldest value, in seconds; None while one is unknown. It `is_lost` if that is so after its poll
    has failed. The oldest one was read `since` seconds ago; None if one never was. `invalid` rows have no value, or one
    that does not fit; `refused` ones the device has answered with an exception.
    """

    device: str
    rows: int
    fresh: int
    age: float | None
    is_lost: bool
    since: float | None
    invalid: int
    refused: int


def source_states(unit: VirtualUnit, now: float) -> Iterator[SourceState]:
    """Make the state of each source, in the order of the config: one at a time, for a unit may have many rows."""
    for device, those in unit.block.by_device.items():
        yield _state(device, those.rows, now, unit.settings.stale)


def sources_at(unit: VirtualUnit, span: Span) -> tuple[str, ...]:
    """List the sources of what is at these addresses, each once."""
    touched = unit.block.touched(span)
    found = dict.fromkeys(row.mapped.device for row in touched.rows)
    for each in touched.others:
        if isinstance(each, FreshBits):
            found |= dict.fromkeys(each.devices)
        elif isinstance(each, SourceAge):
            found[each.device] = None
    return tuple(found)


def _state(device: str, rows: Sequence[Row], now: float, stale: float) -> SourceState:
    fresh = invalid = refused = 0
    is_known, is_lost, first = True, False, now
    for row in rows:
        first = min(first, -inf if row.sampled_at is None else row.sampled_at)
        refused += row.is_refused
        age = row.age(now)
        if age is None:
            is_known = False
            is_lost |= not row.is_awaited
        else:
            invalid += not row.is_valid
            fresh += row.is_valid and age <= stale
    since = None if first == -inf else now - first
    return SourceState(device, len(rows), fresh, since if is_known else None, is_lost, since, invalid, refused)
