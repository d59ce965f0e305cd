"""Checks of points beside guarded ones, in the same registers: some of them can never be written."""

from collections.abc import Iterable, Iterator

from gateway.config.checks.units import profile_of_row
from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.points import points_of
from gateway.config.plan.profiles import guarded
from gateway.config.problem import Problem, warning
from gateway.config.schema.config import Config
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import FunctionCode
from gateway.profiles.guards import Guard, Guards
from gateway.profiles.point import Point

_WRITE_REGISTERS = (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.WRITE_MULTIPLE_REGISTERS)


def check_guards(config: Config) -> Iterator[Problem]:
    """Find points that a guarded one keeps from being written. The config has no errors."""
    for profile in config.profile.values():
        yield from _check_tables(profile.points, (), profile)
    for owner in owners(config):
        for row in rows_of(owner):
            kind = profile_of_row(config, owner, row)
            if row.points and kind is not None:
                yield from _check_tables(row.points, kind.points, kind)


def _check_tables(tables: Iterable[PointTable], others: Iterable[PointTable], kind: ProfileTable) -> Iterator[Problem]:
    tables = tuple(tables)
    guards = Guards.of(guarded((*others, *tables), kind))
    for table in tables if guards else ():
        found = (_trouble(point, guards, kind) for point in points_of([table], kind) if table.write != "no")
        what = next(filter(None, found), None)
        if what is not None:
            remedy = "take write out, or its min and max"
            yield warning((*table.path, "write"), f"it can never be written: {what}", remedy)


def _trouble(point: Point, guards: Guards, kind: ProfileTable) -> str | None:
    """Say why a point cannot be written, if a guard is the reason."""
    place = point.write_span if point.bits is None else Guard.of(point).place
    for guard in guards.touched(place):
        name, addresses = guard.point.name, f"{guard.place.area} {guard.place.addresses}"
        if name != point.name and not _sets_all(point, guard):
            return f"{name} has limits, so one write must set all of {addresses}"
        if point.bits is not None and not _has_turn(point, kind):
            return f"{name} has limits, so function 22 is not for {addresses}"
    return None


def _sets_all(point: Point, guard: Guard) -> bool:
    """Tell whether a write of a point sets all of a guarded one, or none of it."""
    if point.bits is None:
        return point.write_span.has(guard.place)
    own, its = (point.register_masks[Guard.of(point).at], guard.point.register_masks[guard.at])
    return guard.place.count == 1 and own & its in (0, its)


def _has_turn(point: Point, kind: ProfileTable) -> bool:
    """Tell whether bits can be written with a read and a write."""
    return point.write != "only" and (
        kind.functions is None or any(each in kind.functions for each in _WRITE_REGISTERS)
    )
