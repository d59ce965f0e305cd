"""`profile`: what a kind of device accepts, how fast it responds, and the resulting time limits."""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.usage import baud
from gateway.cli.main import FINE, PROBLEM_FOUND, WRONG_USAGE
from gateway.cli.show.limits import limits_as_json, limits_table, milliseconds
from gateway.config.load import load
from gateway.config.plan.areas import places_of
from gateway.config.plan.forecast import FunctionLimits, function_limits
from gateway.config.plan.points import points_of, type_of
from gateway.config.plan.profiles import profile_of
from gateway.config.plan.settings import ASSUMED_LATENCY
from gateway.config.problem import WrongValue, did_you_mean
from gateway.config.reading.builtin_profiles import builtin_profiles
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.config.values.character_format import DEFAULT_FORMATS, fits_mode, parse_format
from gateway.config.values.duration import show_duration
from gateway.config.values.ranges import show_ranges
from gateway.profiles.profile import Profile, Range
from gateway.timing.budget import AnswerTime, Budget
from gateway.timing.characters import CharacterFormat, LineTiming

#: The text for whether a point can be written.
_WRITING: Final[Mapping[str, str]] = {"no": "no", "yes": "yes", "only": "only, never read"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `profile`."""
    parser.add_argument("name", nargs="?", help="name of the profile (default: list all)")
    parser.add_argument("--baud", type=baud, default=19200, metavar="N", help="baud rate of the line (default 19200)")
    parser.add_argument("--format", type=_format, metavar="F", help="character format (default 8E1, ASCII 7E1)")
    parser.add_argument("--mode", choices=("rtu", "ascii"), help="mode of the line (default rtu, mint ascii)")
    parser.add_argument("--config", metavar="FILE", help="config file with more profiles")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Print one profile, or a list of all; 1 if the config file has errors, 2 if there is no such profile."""
    tables = _tables(args.config)
    if tables is None:
        return PROBLEM_FOUND
    if args.name is None:
        print(_list_as_json(tables) if args.json else _list_as_text(tables))
        return FINE
    if args.name not in tables:
        return _wrong_usage(f'there is no profile "{args.name}"; {did_you_mean(args.name, tables)}')
    mode = args.mode or tables[args.name].mode or "rtu"
    format_: CharacterFormat = args.format or DEFAULT_FORMATS[mode]
    if not fits_mode(format_, mode):
        return _wrong_usage(f"RTU needs 8 data bits, and {format_} has {format_.data_bits}; is it --mode ascii?")
    profile = profile_of(args.name, tables[args.name])
    timing = LineTiming(mode, args.baud, format_)
    answer_time = AnswerTime(profile.timing, profile.margin, profile.timeout)
    limits = function_limits(profile, answer_time, Budget(timing, ASSUMED_LATENCY))
    kind = tables[args.name]
    print(_as_json(profile, timing, limits, kind) if args.json else _as_text(profile, timing, limits, kind.points))
    return FINE


def _wrong_usage(what: str) -> int:
    print(f"modbus-gateway: error: {what}", file=sys.stderr)
    return WRONG_USAGE


def _format(text: str) -> CharacterFormat:
    try:
        return parse_format(text)
    except WrongValue as wrong:
        raise argparse.ArgumentTypeError(f"{wrong}: {wrong.remedy}") from wrong


def _tables(config: str | None) -> Mapping[str, ProfileTable] | None:
    """Load the built-in profiles and those of a config file; None if that has errors."""
    if config is None:
        return builtin_profiles()
    loaded = load(config)
    if loaded.config is None:
        print("\n".join(map(str, loaded.problems)), file=sys.stderr)
        return None
    return loaded.config.profile


def _list_as_text(tables: Mapping[str, ProfileTable]) -> str:
    rows = [(name, table.title, table.place) for name, table in tables.items()]
    return align([("NAME", "TITLE", "FROM"), *rows])


def _list_as_json(tables: Mapping[str, ProfileTable]) -> str:
    rows = [{"name": name, "title": table.title, "from": table.place} for name, table in tables.items()]
    return json.dumps(rows, indent=2, ensure_ascii=False)


def _as_text(
    profile: Profile, timing: LineTiming, limits: tuple[FunctionLimits, ...], points: Iterable[PointTable]
) -> str:
    line = f"{timing.mode} {timing.baud} {timing.format}, latency {show_duration(ASSUMED_LATENCY)}"
    parts = [
        f"{profile.name}: {profile.title}" if profile.title else profile.name,
        align(_accepted(profile), "  "),
        *([f"Answer times\n{_timing_table(profile)}"] if profile.timing.rows else []),
        *([f"Points\n{_points_table(points)}"] if points else []),
        f"Time limits, counted from the end of the request: {line}\n{limits_table(limits, '  ')}",
    ]
    return "\n\n".join(parts)


def _accepted(profile: Profile) -> list[tuple[str, str]]:
    functions = "all" if profile.functions is None else ", ".join(map(str, sorted(profile.functions)))
    limits = "; ".join(f"{most} items of function {function}" for function, most in profile.limits.items())
    areas = "; ".join(f"{area} {show_ranges(ranges)}" for area, ranges in profile.areas.items())
    return [
        ("functions", functions),
        ("most items", limits or "as the protocol allows"),
        ("addresses", areas or "all"),
        *([("coils", "function 05 with any value")] if profile.any_coil else []),
        ("end of frame", f"{profile.idle_chars:g} characters of silence"),
        ("margin", f"{profile.margin:g} x the answer times"),
        ("time-out", f"{show_duration(profile.timeout)} for functions without an answer time"),
    ]


def _timing_table(profile: Profile) -> str:
    rows = [
        (str(function), str(point.items), show_duration(point.time))
        for function, row in profile.timing.rows.items()
        for point in row
    ]
    return align([("FUNCTION", "ITEMS", "TIME"), *rows], "  ")


def _points_table(points: Iterable[PointTable]) -> str:
    """Show one row for each table of the config: a range of points is one row."""
    rows = [
        (table.name, area, _span(addresses), type_of(table, area), table.unit, _WRITING[table.write])
        for table in points
        for area, addresses in places_of(table)
    ]
    return align([("NAME", "AREA", "ADDRESS", "TYPE", "UNIT", "WRITE"), *rows], "  ")


def _span(addresses: Range) -> str:
    first, last = addresses
    return str(first) if first == last else f"{first}-{last}"


def _as_json(profile: Profile, timing: LineTiming, limits: tuple[FunctionLimits, ...], kind: ProfileTable) -> str:
    picture: dict[str, Any] = {
        "name": profile.name,
        "title": profile.title,
        "functions": None if profile.functions is None else sorted(profile.functions),
        "limits": profile.limits,
        "areas": profile.areas,
        "coil_values": "any" if profile.any_coil else "checked",
        "idle_chars": profile.idle_chars,
        "margin": profile.margin,
        "timeout_ms": milliseconds(profile.timeout),
        "timing": [
            {"function": function, "items": point.items, "time_ms": milliseconds(point.time)}
            for function, row in profile.timing.rows.items()
            for point in row
        ],
        "points": [asdict(point) for point in points_of(kind.points, kind)],
        "line": {"mode": timing.mode, "baud": timing.baud, "format": str(timing.format)},
        "time_limits": limits_as_json(limits),
    }
    return json.dumps(picture, indent=2, ensure_ascii=False)
