"""The values of a unit: which points are meant, and the requests that read and write them, for any door."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from gateway.config.problem import did_you_mean
from gateway.errors import DoesNotFit, ExceptionReceived, Malformed, WrongQuestion
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.values.requests import Ask
from gateway.operator.values.steps import Answer, NewValues, Outcome, Steps, reading, writing
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, width_at
from gateway.profiles.writing import to_be_writable
from gateway.registers.datatypes import DATA_TYPES, SWAPS, fits_wide, registers_of
from gateway.registers.items import REGISTER, has_bits, usual_type

#: The most items of one read: at most 16 requests on a line.
MOST_ITEMS: Final = 2000
_LAST_ADDRESS: Final = 65535


def values_at(
    area: Area,
    first: int,
    last: int | None,
    data_type: str,
    swap: str,
    wide: Mapping[str, tuple[Range, ...]] = MappingProxyType({}),
) -> list[Point]:
    """List the values at the addresses from `first` to `last`, as nameless points; one value without `last`.

    `wide` are the registers of four bytes.

    Raises:
        Malformed: there is no such type, or it does not fit.
    """
    width = width_at(wide, Span(area, first, 1)) or REGISTER
    data_type = data_type or usual_type(area, width)
    last = first + registers_of(data_type, width) - 1 if last is None else last
    count = last - first + 1
    if count < 1 or last > _LAST_ADDRESS or count > MOST_ITEMS:
        raise Malformed(f"{first}-{last}: addresses are 0 to {_LAST_ADDRESS}, at most {MOST_ITEMS} at a time")
    if data_type not in DATA_TYPES or (data_type == "bit") != has_bits(area):
        raise Malformed(f"type: {area} cannot be {data_type}")
    if swap not in SWAPS or (swap != "none" and has_bits(area)):
        raise Malformed(f"swap: {area} cannot be read with {swap}")
    if width != width_at(wide, Span(area, first, count)):
        raise Malformed(f"only some of {area} {first}-{last} have four bytes: read them apart")
    if width > REGISTER and not fits_wide(data_type):
        raise Malformed(f"type: {area} {first} has four bytes, and a {data_type} has two")
    size = count if data_type == "string" else registers_of(data_type, width)
    if count % size:
        raise Malformed(f"{first}-{last} are {count} registers, and each {data_type} takes {size}")
    return [Point("", area, at, data_type, swap, size, write="yes", width=width) for at in range(first, last + 1, size)]


def point_named(unit: UnitPicture, name: str) -> Point:
    """Find a point of a unit.

    Raises:
        WrongQuestion: it has none of this name.
    """
    for point in unit.points:
        if point.name == name:
            return point
    remedy = did_you_mean(name, (point.name for point in unit.points))
    raise WrongQuestion(f'{unit.name or unit.unit} has no point "{name}"' + (f"; {remedy}" if remedy else ""))


async def read(
    unit: UnitPicture, points: Sequence[Point], ask: Ask, holes: Holes | None = None, apart: Sequence[Point] = ()
) -> Outcome:
    """Read points in as few requests as the unit allows; named ones that it refuses together are read apart.

    `holes` are those that it has refused. Points `apart` are read in requests of their own.

    Raises:
        UnitFailed: nothing could be read, or values without names only in part.
        ChangedMeanwhile: a reload has given the unit's number to another target.
    """
    outcome = await carried_out(reading(points, unit.read_rules, Holes() if holes is None else holes), ask)
    outcome.add(await carried_out(reading(apart, unit.read_rules, Holes()), ask))
    if outcome.failures and not (outcome.readings and (*points, *apart)[0].name):
        raise refused(outcome.failures[0].answer)
    return outcome


async def write(new: NewValues, ask: Ask) -> Outcome:
    """Write values, with one request.

    Raises:
        DoesNotFit: see `writing`.
        UnitFailed: the unit did not carry it out, or a scale could not be read.
        ChangedMeanwhile: a reload has given the unit's number to another target.
    """
    outcome = await carried_out(writing(new), ask)
    if outcome.failures:
        raise refused(outcome.failures[0].answer)
    return outcome


def assigned(unit: UnitPicture, points: Sequence[Point], values: Sequence[object]) -> NewValues:
    """Assign values out of JSON to points of a unit.

    Raises:
        DoesNotFit: a point is read-only, or one is no value.
    """
    texts = [_text(point, value) for point, value in zip(points, values, strict=True)]
    return NewValues(points, texts, unit.limits, unit.functions)


def refused(answer: Answer) -> ExceptionReceived:
    """Make the error for an exception response."""
    said = answer.complaint
    return ExceptionReceived(str(said), said.code, said.result, said.reason)


async def carried_out(steps: Steps, ask: Ask) -> Outcome:
    """Send each request, and pass the answer to the next step."""
    try:
        step = next(steps)
        while True:
            step = steps.send(await ask(step))
    except StopIteration as end:
        outcome: Outcome = end.value
        return outcome


def _text(point: Point, value: object) -> str:
    """Write a value out of JSON as text: a number, a truth value, a label, text."""
    if point.write == "no":
        raise DoesNotFit(f"{point.name} is read-only", f"set {to_be_writable(point)} for this point")
    if not isinstance(value, str | int | float):
        raise DoesNotFit(f"expected a number, boolean or string, got {'null' if value is None else repr(value)}")
    return str(int(value)) if isinstance(value, bool) else str(value)
