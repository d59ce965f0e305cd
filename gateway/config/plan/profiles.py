"""A kind of device, as its table describes it."""

from collections.abc import Iterable

from gateway.config.plan.points import points_of
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.timing.table import Point as TimingPoint
from gateway.timing.table import TimingTable


def profile_of(name: str, table: ProfileTable) -> Profile:
    """Turn a table into the profile that it describes."""
    areas = {area: ranges for area in Area if (ranges := getattr(table, area)) is not None}
    points: dict[int, list[TimingPoint]] = {}
    for row in table.timing:
        points.setdefault(row.fc, []).append(TimingPoint(row.items, row.time))
    return Profile(
        name=name,
        title=table.title,
        maker=table.maker,
        functions=None if table.functions is None else frozenset(table.functions),
        limits=table.limits,
        areas=areas,
        idle_chars=table.idle_chars,
        timing=TimingTable.of(points),
        margin=table.margin,
        timeout=table.timeout,
        any_coil=table.coil_values == "any",
        quirks=frozenset(table.quirks),
        wake=table.wake,
        wide=table.wide,
        max_gap=table.max_gap,
        only_written=only_written(table.points, table),
        identity=table.identity,
    )


def guarded_profile_of(name: str, table: ProfileTable) -> Profile:
    """Make the profile of devices that a table describes: with the guards of its points."""
    return profile_of(name, table).guarding(guarded(table.points, table))


def guarded(points: Iterable[PointTable], kind: ProfileTable) -> tuple[Point, ...]:
    """Make those of the points of a kind of device that are written within limits only."""
    tables = [each for each in points if each.write != "no" and not (each.min is None and each.max is None)]
    return points_of(tables, kind) if tables else ()


def only_written(points: Iterable[PointTable], kind: ProfileTable) -> tuple[Span, ...]:
    """Find where the points of a kind of device are that are never read."""
    tables = [each for each in points if each.write == "only"]
    return tuple(point.span for point in points_of(tables, kind)) if tables else ()
