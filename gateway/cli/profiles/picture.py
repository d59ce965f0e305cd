"""One profile: what a kind of device accepts, its points, its answer times and the limits that follow."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.profiles.known import Known
from gateway.cli.show.devices import limits_as_json, limits_table, milliseconds
from gateway.config.documents.points import identity_text, point_rows
from gateway.config.plan.forecast import FunctionLimits, function_limits
from gateway.config.plan.points import points_of
from gateway.config.plan.profiles import profile_of
from gateway.config.plan.settings import ASSUMED_LATENCY
from gateway.config.reading.profile_file import SHIPPED
from gateway.config.schema.profile import ProfileTable
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime, Budget
from gateway.timing.characters import LineTiming

#: The columns of the table of points, by their cells; others are left out where nothing stands in them.
_ALWAYS: Final = ("name", "area", "address", "type", "unit", "write")
_COLUMNS: Final = ("name", "area", "address", "type", "scale", "unit", "write", "limits", "no value", "labels")


def picture_as_text(known: Known, timing: LineTiming) -> str:
    """Show a profile for people, with its time limits on a line."""
    table, profile = known.table, profile_of(known.origin.name, known.table)
    line = f"{timing.mode} {timing.baud} {timing.format}, latency {show_duration(ASSUMED_LATENCY)}"
    parts = [
        f"{profile.name}: {profile.title}" if profile.title else profile.name,
        align([*_origin(known), *_accepted(profile, table)], "  "),
        *([f"Answer times\n{_timing_table(profile)}"] if profile.timing.rows else []),
        *([f"Points\n{_points_table(table)}"] if table.points else []),
        f"Time limits, counted from the end of the request: {line}\n{limits_table(_limits(profile, timing), '  ')}",
    ]
    return "\n\n".join(parts)


def picture_as_json(known: Known, timing: LineTiming) -> str:
    """Make the same for programs."""
    table, profile = known.table, profile_of(known.origin.name, known.table)
    picture: dict[str, Any] = {
        "name": profile.name,
        "title": profile.title,
        "maker": table.maker,
        "source": table.source,
        "seen": table.seen,
        "from": known.origin.place,
        "hides": known.origin.hides,
        "identity": None if table.identity is None else asdict(table.identity),
        "functions": None if profile.functions is None else sorted(profile.functions),
        "limits": profile.limits,
        "areas": profile.areas,
        "wide": profile.wide,
        "max_gap": profile.max_gap,
        "write_function": table.write_function,
        "coil_values": "any" if profile.any_coil else "checked",
        "idle_chars": profile.idle_chars,
        "margin": profile.margin,
        "timeout_ms": milliseconds(profile.timeout),
        "wake_ms": milliseconds(profile.wake),
        "timing": [
            {"function": function, "items": point.items, "time_ms": milliseconds(point.time)}
            for function, row in profile.timing.rows.items()
            for point in row
        ],
        "points": [asdict(point) for point in points_of(table.points, table)],
        "line": {"mode": timing.mode, "baud": timing.baud, "format": str(timing.format)},
        "time_limits": limits_as_json(_limits(profile, timing)),
    }
    return json.dumps(picture, indent=2, ensure_ascii=False)


def _limits(profile: Profile, timing: LineTiming) -> tuple[FunctionLimits, ...]:
    answer_time = AnswerTime(profile.timing, profile.margin, profile.timeout)
    return function_limits(profile, answer_time, Budget(timing, ASSUMED_LATENCY))


def _origin(known: Known) -> Iterator[tuple[str, str]]:
    """Say where the profile comes from, and what its author knows of it."""
    if known.origin.place != SHIPPED:
        yield "from", str(known.origin)
    yield from ((key, text) for key in ("maker", "source", "seen") if (text := getattr(known.table, key)))
    if known.table.identity is not None:
        yield "recognised by", identity_text(known.table.identity)


def _accepted(profile: Profile, table: ProfileTable) -> Iterator[tuple[str, str]]:
    yield "functions", "all" if profile.functions is None else ", ".join(map(str, sorted(profile.functions)))
    limits = "; ".join(f"{most} items of function {function}" for function, most in profile.limits.items())
    yield "most items", limits or "as the protocol allows"
    yield "addresses", "; ".join(f"{area} {show_ranges(ranges)}" for area, ranges in profile.areas.items()) or "all"
    if profile.wide:
        wide = "; ".join(f"{area} {show_ranges(ranges)}" for area, ranges in profile.wide.items())
        yield "four bytes", f"{wide}: registers of four bytes each"
    if profile.max_gap:
        yield "gaps", f"points are read together over up to {profile.max_gap} addresses between them"
    if table.write_function != "auto":
        functions = "05 and 06" if table.write_function == "single" else "15 and 16"
        yield "writes", f"points with functions {functions}"
    if profile.any_coil:
        yield "coils", "function 05 with any value"
    if profile.wake:
        yield "sleeps", f"after {show_duration(profile.wake)} without a request"
    yield "end of frame", f"{profile.idle_chars:g} characters of silence"
    yield "margin", f"{profile.margin:g} x the answer times"
    yield "time-out", f"{show_duration(profile.timeout)} for functions without an answer time"


def _timing_table(profile: Profile) -> str:
    rows = [
        (str(function), str(point.items), show_duration(point.time))
        for function, row in profile.timing.rows.items()
        for point in row
    ]
    return align([("FUNCTION", "ITEMS", "TIME"), *rows], "  ")


def _points_table(table: ProfileTable) -> str:
    """Show one row for each table of the config: a range of points is one row."""
    rows = list(point_rows(table))
    columns = [each for each in _COLUMNS if each in _ALWAYS or any(row[each] for row in rows)]
    return align([[each.upper() for each in columns], *([row[each] for each in columns] for row in rows)], "  ")
