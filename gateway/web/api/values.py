"""Values of a unit over HTTP: which requests read or write them, and their JSON."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from gateway.errors import ExceptionCode, WrongQuestion
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.modbus.pdu import Span
from gateway.profiles.batches import Batch, batches
from gateway.profiles.point import Point, Reading
from gateway.registers.datatypes import DATA_TYPES, SWAPS, registers_of
from gateway.registers.items import WRITERS, has_bits, most_written, write_request
from gateway.web.api.answers import Answer, Unit
from gateway.web.front.problems import Complaint, ProblemError, complaint, exception_problem

#: Items that one request over HTTP reads at most: at most 16 requests on a line.
MOST_ITEMS: Final = 2000
_LAST_ADDRESS: Final = 65535
#: After these a part of a request may be answered.
_MAY_BE_ANSWERED_IN_PARTS: Final = frozenset({ExceptionCode.ILLEGAL_DATA_ADDRESS, ExceptionCode.ILLEGAL_DATA_VALUE})

#: Sends a request PDU to the unit.
Ask = Callable[[bytes], Awaitable[Answer]]


@dataclass(slots=True)
class _Failure:
    span: Span
    answer: Answer


@dataclass(slots=True)
class Outcome:
    """What was read or written, and what failed."""

    readings: list[Reading] = field(default_factory=list)
    failures: list[_Failure] = field(default_factory=list)
    elapsed_ms: float = 0.0

    def trouble_of(self, point: Point) -> Complaint | None:
        """Why a point could not be read; None if nothing is known of that."""
        at = (each for each in self.failures if each.span.area == point.area)
        return next((complaint(each.answer) for each in at if each.span.start <= point.address < each.span.end), None)

    def as_json(self, unit: Unit, area: Area | None) -> dict[str, Any]:
        """For programs: of one area, or of points, which have each its own."""
        told: dict[str, Any] = {"unit": unit.unit, "name": unit.name}
        if area is not None:
            told["area"] = area
        told["values"] = [each.as_json(with_area=area is None) for each in self.readings]
        told["elapsed_ms"] = round(self.elapsed_ms, 1)
        if self.failures:
            told["errors"] = [
                {
                    "area": each.span.area,
                    "address": each.span.start,
                    "count": each.span.count,
                    "exception": each.answer.pdu[1],
                    "reason": str(complaint(each.answer)),
                }
                for each in self.failures
            ]
        return told


def values_at(area: Area, first: int, last: int | None, data_type: str, swap: str) -> list[Point]:
    """The values at the addresses from `first` to `last`, as nameless points; one value if there is no last one.

    Raises:
        ProblemError: there is no such type, or it does not fit.
    """
    usual = "bit" if has_bits(area) else "uint16"
    data_type = data_type or usual
    last = first + registers_of(data_type) - 1 if last is None else last
    count = last - first + 1
    if count < 1 or last > _LAST_ADDRESS or count > MOST_ITEMS:
        raise ProblemError(400, f"{first}-{last}: addresses are 0 to {_LAST_ADDRESS}, at most {MOST_ITEMS} at a time")
    if data_type not in DATA_TYPES or (data_type == "bit") != has_bits(area):
        raise ProblemError(400, f"type: {area} cannot be {data_type}")
    if swap not in SWAPS or (swap != "none" and has_bits(area)):
        raise ProblemError(400, f"swap: {area} cannot be read with {swap}")
    size = count if data_type == "string" else registers_of(data_type)
    if count % size:
        raise ProblemError(400, f"{first}-{last} are {count} registers, and each {data_type} takes {size}")
    return [Point("", area, at, data_type, swap, size, write="yes") for at in range(first, last + 1, size)]


def point_named(unit: Unit, name: str) -> Point:
    """A point of a unit.

    Raises:
        WrongQuestion: it has none of this name.
    """
    for point in unit.points:
        if point.name == name:
            return point
    raise WrongQuestion(f"unit {unit.unit} has no point {name}")


async def read(unit: Unit, points: Sequence[Point], ask: Ask) -> Outcome:
    """Read points in as few requests as the unit allows; named ones that it refuses together are read one by one.

    Raises:
        ProblemError: nothing could be read, or of values without names not all.
    """
    outcome = Outcome()
    for batch in batches(points, unit.limits):
        await _read(batch, ask, outcome)
    if outcome.failures and not (outcome.readings and points[0].name):
        raise exception_problem(outcome.failures[0].answer)
    order = {id(point): index for index, point in enumerate(points)}
    outcome.readings.sort(key=lambda reading: order[id(reading.point)])
    return outcome


async def _read(batch: Batch, ask: Ask, outcome: Outcome) -> None:
    answer = await ask(batch.request)
    outcome.elapsed_ms += answer.elapsed_ms
    if not answer.pdu[0] & EXCEPTION_BIT:
        try:
            outcome.readings += [Reading(point, items) for point, items in batch.items_read(answer.pdu)]
        except ValueError as wrong:
            raise ProblemError(502, str(wrong)) from wrong
    elif answer.pdu[1] in _MAY_BE_ANSWERED_IN_PARTS and len(batch.points) > 1 and batch.points[0].name:
        for point in batch.points:
            await _read(Batch(point.span, (point,)), ask, outcome)
    else:
        outcome.failures.append(_Failure(batch.span, answer))


async def write(unit: Unit, points: Sequence[Point], values: Sequence[object], ask: Ask) -> Outcome:
    """Write values to points that lie side by side, with one request.

    Raises:
        ProblemError: a point cannot hold its value or be written, they do not fit into one request, or the unit has
            answered with an exception.
    """
    readings, request = prepared(unit, points, values)
    answer = await ask(request)
    if answer.pdu[0] & EXCEPTION_BIT:
        raise exception_problem(answer)
    return Outcome(readings, [], answer.elapsed_ms)


def prepared(unit: Unit, points: Sequence[Point], values: Sequence[object]) -> tuple[list[Reading], bytes]:
    """What is to be there afterwards, by address, and the request that writes it.

    Raises:
        ProblemError: a point cannot hold its value or be written, or they do not fit into one request.
    """
    readings = sorted(
        (Reading(point, _items(point, value)) for point, value in zip(points, values, strict=True)),
        key=lambda reading: reading.point.address,
    )
    return readings, _write_request(unit, readings)


def _write_request(unit: Unit, readings: Sequence[Reading]) -> bytes:
    """The request that writes them."""
    first, count = readings[0].point, 0
    if first.area not in WRITERS:
        raise ProblemError(422, f"{first.area} cannot be written; coils and holding can")
    for reading in readings:
        if (reading.point.area, reading.point.address) != (first.area, first.address + count):
            raise ProblemError(422, "what one request writes must lie side by side; write them one by one")
        count += reading.point.count
    most = most_written(first.area, unit.limits)
    if count > most:
        raise ProblemError(422, f"{count} are too many for one request; write at most {most} at a time")
    return write_request(first.area, first.address, b"".join(each.items for each in readings), unit.functions)


def _items(point: Point, value: object) -> bytes:
    """The items that carry a value out of JSON: a number, a truth value, a label, text."""
    if point.write == "no":
        raise ProblemError(422, f"{point.name} is not to be written; if it is, its point needs write = true")
    if not isinstance(value, str | int | float):
        raise ProblemError(422, f"{value!r} is no value: write a number, true or false, or text")
    try:
        return point.items(str(int(value)) if isinstance(value, bool) else str(value))
    except (ValueError, ArithmeticError) as wrong:
        raise ProblemError(422, str(wrong)) from wrong
