"""Operations that read and write the values of a unit, by their addresses or by the names of its points."""

from collections.abc import Sequence

from gateway.clock.slices import in_slices
from gateway.errors import DoesNotFit, Malformed, WrongQuestion
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.answers.values import Points, Values
from gateway.operator.operations.asked import (
    Addresses,
    PointsToRead,
    PointsToWrite,
    PointToRead,
    PointToWrite,
    ValuesToWrite,
)
from gateway.operator.operations.operation import Asker
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operator import Operator
from gateway.operator.units.reached import holes_of
from gateway.operator.units.units import picture
from gateway.operator.values.last_values import forget_values, read_all
from gateway.operator.values.requests import ask_for
from gateway.operator.values.steps import Outcome, value_told, values_told
from gateway.operator.values.unit_values import assigned, point_named, read, values_at, write
from gateway.profiles.point import Point


async def read_values(operator: Operator, asked: Addresses, asker: Asker) -> Values:
    """Read values by their addresses.

    Raises:
        WrongQuestion: there is no such unit, the addresses are invalid, or the unit did not answer with all values.
    """
    unit = _any_unit(operator, asked.unit)
    return await _read(operator, unit, points_at(asked, unit), asker, asked.area)


async def read_points(operator: Operator, asked: PointsToRead, asker: Asker) -> Points:
    """Read all points of a unit that can be read.

    Raises:
        WrongQuestion: there is no such unit, or nothing could be read.
    """
    unit = picture(operator, asked.unit)
    outcome, age = await read_all(operator, unit, asker, asked.max_age)
    return Points(**fields_of(await _told(unit, None, outcome)), age_ms=round(age * 1000, 1))


async def read_point(operator: Operator, asked: PointToRead, asker: Asker) -> Values:
    """Read one point.

    Raises:
        WrongQuestion: there is no such point, or it could not be read.
    """
    unit = picture(operator, asked.unit)
    point = point_named(unit, asked.name)
    if point.write == "only":
        raise DoesNotFit(f"{point.name} can be written, but not read")
    return await _read(operator, unit, [point], asker)


async def write_values(operator: Operator, asked: ValuesToWrite, asker: Asker) -> Values:
    """Write values from an address on, with one request.

    Raises:
        WrongQuestion: there is no such unit, the values do not fit, or the unit did not carry it out.
    """
    unit = _any_unit(operator, asked.unit)
    points = points_at(asked, unit)
    if len(points) != len(asked.values):
        raise Malformed(f"{len(asked.values)} values do not fill {len(points)} places")
    return await _write(operator, unit, points, asked.values, asker, asked.area)


async def write_point(operator: Operator, asked: PointToWrite, asker: Asker) -> Values:
    """Write one point.

    Raises:
        WrongQuestion: there is no such point, the value does not fit, or the unit did not carry it out.
    """
    unit = picture(operator, asked.unit)
    point = point_named(unit, asked.name)
    if len(asked.values) != 1:
        raise Malformed(f"{point.name} takes one value, not {len(asked.values)}")
    return await _write(operator, unit, [point], asked.values, asker)


async def write_points(operator: Operator, asked: PointsToWrite, asker: Asker) -> Values:
    """Write points that lie side by side, with one request.

    Raises:
        WrongQuestion: there is no such point, a value does not fit, or the unit did not carry it out.
    """
    unit = picture(operator, asked.unit)
    points = [point_named(unit, str(each.point)) for each in asked.values]
    return await _write(operator, unit, points, [each.value for each in asked.values], asker)


def points_at(asked: Addresses, unit: UnitPicture) -> list[Point]:
    """List the requested values as nameless points.

    Raises:
        Malformed: there is no such type, or it does not fit.
    """
    return values_at(asked.area, asked.start, asked.end, asked.type, asked.swap, unit.wide)


def _any_unit(operator: Operator, wanted: int | str) -> UnitPicture:
    """Describe a unit; a number that is not configured is asked nevertheless, and the answer is 0A."""
    try:
        return picture(operator, wanted)
    except WrongQuestion:
        if not isinstance(wanted, int):
            raise
        return UnitPicture(wanted, "", "", "", None, {}, {}, 0.0, ())


async def _read(
    operator: Operator, unit: UnitPicture, points: Sequence[Point], asker: Asker, area: Area | None = None
) -> Values:
    ask = ask_for(operator, unit.key, asker)
    return await _told(unit, area, await read(unit, points, ask, holes_of(operator.gateway, unit.key)))


async def _write(
    operator: Operator,
    unit: UnitPicture,
    points: Sequence[Point],
    values: Sequence[object],
    asker: Asker,
    area: Area | None = None,
) -> Values:
    """Write, and drop the last values of the unit, even if there was no response."""
    ask, new = ask_for(operator, unit.key, asker), assigned(unit, points, values)
    try:
        outcome = await write(new, ask)
    finally:
        forget_values(operator, unit)
    return await _told(unit, area, outcome)


async def _told(unit: UnitPicture, area: Area | None, outcome: Outcome) -> Values:
    """Convert an outcome, with pauses for the lines."""
    values = await in_slices(value_told(each, area) for each in outcome.readings)
    return values_told(unit.unit, unit.name, area, outcome, values)
