"""Cross-checks of points: impossible ones, and duplicate names."""

from collections.abc import Iterable, Iterator, Mapping

from gateway.config.checks.point_values import check_scale, check_type, check_value
from gateway.config.checks.point_writing import check_place, check_reading, check_writing
from gateway.config.checks.units import profile_of_row
from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.points import names_of, places_of, width_of
from gateway.config.problem import Problem, error
from gateway.config.schema.config import Config
from gateway.config.schema.profile import PointTable, ProfileTable


def check_points(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find points that are not possible, and names that two points of a unit have. `failed` as in `check`."""
    for profile in config.profile.values():
        yield from _check_tables(profile.points, profile, ())
        yield from _check_names(profile.points, {}, profile)
    for owner in owners(config):
        for row in rows_of(owner):
            named = None if "profile" in failed else profile_of_row(config, owner, row)
            others = () if named is None else named.points
            yield from _check_tables(row.points, named, others)
            yield from _check_names(row.points, _names(others, named) if row.points else {}, named)


def _check_tables(
    tables: Iterable[PointTable], profile: ProfileTable | None, others: Iterable[PointTable]
) -> Iterator[Problem]:
    """Check points of a `profile`; `others` are the points that a device has beside them."""
    tables = tuple(tables)
    of_unit = (*others, *tables)
    for table in tables:
        if len(places_of(table)) != 1:
            what = "must have one of holding, input, coils and discrete"
            yield error(table.path, what, "such as holding = 16; addresses count from 0: 40017 is 16")
            continue
        ((area, addresses),) = places_of(table)
        width = width_of(area, addresses[0], profile)
        wrong_type = [*check_type(table, area, width)]
        yield from wrong_type
        if not wrong_type:
            yield from check_place(table, area, addresses, profile, width)
            yield from check_reading(table, area, profile, width)
            yield from check_writing(table, area, addresses, profile, width)
            yield from check_scale(table, area, addresses, of_unit, profile)
        yield from check_value(table, area)


def _check_names(
    tables: Iterable[PointTable], taken: Mapping[str, str], profile: ProfileTable | None
) -> Iterator[Problem]:
    names = dict(taken)
    for table in tables:
        own = _names((table,), profile)
        twice = next((name for name in own if name in names), None)
        if twice is not None:
            yield error((*table.path, "name"), f'the point "{twice}" is already there: {names[twice]}')
        names |= own


def _names(tables: Iterable[PointTable], profile: ProfileTable | None) -> dict[str, str]:
    """Collect the names of points, each with its place in the config."""
    return {
        name: place
        for table in tables
        for place in (table.place,)
        for area, addresses in places_of(table)
        for name in names_of(table, area, addresses, width_of(area, addresses[0], profile))
    }
