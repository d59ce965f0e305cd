"""The last reads of all points of units, shared by readers: any number of open pages costs a line no more than one."""

import asyncio
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Door, Operator
from gateway.operator.units.reached import ReadableHoles, holes_of, readable_for, target
from gateway.operator.values.requests import ask_for
from gateway.operator.values.steps import Outcome
from gateway.operator.values.unit_values import read
from gateway.profiles.point import Point

#: Units whose last reads are kept.
MOST_UNITS: Final = 256

#: Unit, door, and what may be read of its points there: values are shared only between equal rights.
_Key = tuple[int, Door, frozenset[Area | Span]]


@dataclass(slots=True)
class _Last:
    """The last values of a unit, valid while `unit` and `target` stay the same. `turn` is held while they are read."""

    unit: UnitPicture
    target: object
    outcome: Outcome | None = None
    at: float = 0.0
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class _LastOfAll(OrderedDict[_Key, _Last]):
    """The last values of units, least recently read first."""


async def read_all(operator: Operator, unit: UnitPicture, asker: Asker, max_age: float) -> tuple[Outcome, float]:
    """Read all readable points, unless they were read less than `max_age` seconds ago; return their age too.

    Raises:
        UnitFailed: nothing could be read.
        ChangedMeanwhile: a reload has given the unit's number to another target.
    """
    ask, last = ask_for(operator, unit.key, asker), _of(operator, unit, asker)
    clock = asyncio.get_running_loop().time
    asked_at = clock()
    async with last.turn:
        now = clock()
        if last.outcome is None or last.at < asked_at - max_age:
            may_read = readable_for(operator, unit, asker)
            points, holes = readable(unit), ReadableHoles(holes_of(operator.gateway, unit.key), may_read)
            allowed = [point for point in points if may_read.has(point.read_span)]
            refused = [point for point in points if not may_read.has(point.read_span)]
            last.outcome, last.at = await read(unit, allowed, ask, holes, refused) if points else Outcome(), now
        return last.outcome, clock() - last.at


def last_read(operator: Operator, unit: UnitPicture, asker: Asker) -> tuple[Outcome, float] | None:
    """Find the outcome of the last `read_all`, and its age in seconds; None if there was none since a write."""
    now, last = asyncio.get_running_loop().time(), operator.kept(_LastOfAll).get(_key(operator, unit, asker))
    if last is None or last.outcome is None or _has_changed(operator, last, unit):
        return None
    return last.outcome, now - last.at


def forget_values(operator: Operator, unit: UnitPicture) -> None:
    """Drop the last values of a unit, after a write."""
    kept = operator.kept(_LastOfAll)
    for key in [key for key in kept if key[0] == unit.key]:
        del kept[key]


def readable(unit: UnitPicture) -> Sequence[Point]:
    """List the points that can be read."""
    return [point for point in unit.points if point.write != "only"]


def _of(operator: Operator, unit: UnitPicture, asker: Asker) -> _Last:
    kept, key = operator.kept(_LastOfAll), _key(operator, unit, asker)
    last = kept.get(key)
    if last is None or _has_changed(operator, last, unit):
        last = kept[key] = _Last(unit, target(operator.gateway, unit.key))
    kept.move_to_end(key)
    if len(kept) > MOST_UNITS:
        kept.popitem(last=False)
    return last


def _has_changed(operator: Operator, last: _Last, unit: UnitPicture) -> bool:
    """Return whether a reload has given the number to another target, or changed the unit's points."""
    return last.unit != unit or last.target is not target(operator.gateway, unit.key)


def _key(operator: Operator, unit: UnitPicture, asker: Asker) -> _Key:
    may_read = readable_for(operator, unit, asker)
    spans = {point.read_span for point in unit.points if point.area not in may_read.areas}
    return unit.key, asker.door, may_read.areas.union(span for span in spans if may_read.has(span))
