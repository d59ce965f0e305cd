"""The points of a unit as its page shows them: their latest known values, or those that an image or a mirror has."""

import asyncio
from dataclasses import dataclass
from typing import Any, Literal

from aiohttp import web

from gateway.operator.images.kept import Kept, kept
from gateway.operator.operations.answers.known_values import ValueState
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import readable_for
from gateway.operator.values.complaint import Complaint
from gateway.operator.values.known_values import Known, known_points, state_of
from gateway.operator.values.last_values import last_read, readable
from gateway.operator.values.steps import Outcome
from gateway.profiles.point import NO_VALUE, Point
from gateway.registers.items import reference
from gateway.web.access.guard import VISITOR
from gateway.web.api.asking import asker_of
from gateway.web.pages.write_rights import WriteRights


@dataclass(frozen=True, slots=True)
class ShownPoint:
    """A point and its value as text; empty if it is not known. `source` is the client that asked a device for it.

    If it could not be read since, `trouble` says why.
    """

    point: Point
    reference: str
    value: str
    age_ms: float | None = None
    state: ValueState | Literal[""] = ""
    source: str = ""
    trouble: Complaint | None = None


def points_shown(operator: Operator, rights: WriteRights, unit: UnitPicture, request: web.Request) -> dict[str, Any]:
    """Collect what the template `points.html` shows."""
    asker = asker_of(request)
    last = last_read(operator, unit, asker) if unit.is_asked else None
    return {
        "points": _points(operator, unit, asker, last),
        "no_value": NO_VALUE,
        "can_be_read": bool(readable(unit)),
        "was_read_ago": None if last is None else last[1],
        **rights.of(unit, request[VISITOR]).as_content(),
    }


def reference_of(point: Point) -> str:
    """Return the number that a point has in many manuals, with its bits."""
    return reference(point.area, point.address) + point.bits_shown


def _points(
    operator: Operator, unit: UnitPicture, asker: Asker, last: tuple[Outcome, float] | None
) -> list[ShownPoint]:
    if unit.is_device:
        return _heard(operator, unit, asker, last)
    return _read(unit, last) if unit.is_asked else _held(operator, unit, asker)


def _read(unit: UnitPicture, last: tuple[Outcome, float] | None) -> list[ShownPoint]:
    """List the points of a unit of which nothing is known but what was read `last`."""
    outcome, age = last or (Outcome(), 0.0)
    found = {each.point.name: each for each in outcome.readings}
    return [
        ShownPoint(point, reference_of(point), "", trouble=outcome.trouble_of(point))
        if point.name not in found
        else ShownPoint(point, reference_of(point), found[point.name].text, 1000 * age, "fresh")
        for point in unit.points
    ]


def _heard(operator: Operator, unit: UnitPicture, asker: Asker, last: tuple[Outcome, float] | None) -> list[ShownPoint]:
    """List the points of a device with their latest known values, as far as the asker may read them."""
    now = asyncio.get_running_loop().time()
    known = {each.point.name: each for each in known_points(operator, unit, asker)}
    return [_known(point, known.get(point.name), last, now) for point in unit.points]


def _held(operator: Operator, unit: UnitPicture, asker: Asker) -> list[ShownPoint]:
    """List the points of an image or a mirror with the values that it has, as far as the asker may read them."""
    readable, now = readable_for(operator, unit, asker), asyncio.get_running_loop().time()
    spans = [point.read_span for point in unit.points]
    there = kept(operator.gateway, unit.key, spans, now)
    return [
        _kept(point, each if readable.has(span) else None)
        for point, span, each in zip(unit.points, spans, there, strict=True)
    ]


def _known(point: Point, known: Known | None, last: tuple[Outcome, float] | None, now: float) -> ShownPoint:
    """Show what is known of a point, or why the `last` read of it failed, if nothing was heard since."""
    read, reading = (None, None) if known is None else (known.read, known.reading)
    age = None if known is None else known.age(now)
    return ShownPoint(
        point,
        reference_of(point),
        "" if reading is None else reading.text,
        None if age is None else 1000 * age,
        "" if known is None else state_of(known, reading, now),
        "" if read is None else read.caller.client,
        last[0].trouble_of(point) if last is not None and (age is None or last[1] < age) else None,
    )


def _kept(point: Point, kept: Kept | None) -> ShownPoint:
    """Show what an image or a mirror has of a point."""
    if kept is None or kept.age_ms is None:
        return ShownPoint(point, reference_of(point), "", state="" if kept is None else "never")
    text = point.show(point.value(kept.items))
    return ShownPoint(point, reference_of(point), text, kept.age_ms, "stale" if kept.is_stale else "fresh")
