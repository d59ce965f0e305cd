"""The built-in profiles for simulated devices: their functions, limits, answer times and idle times.

They are read without the checks of a config, which take longer to import than a simulator otherwise needs to start.
"""

import tomllib

from gateway.config.values.duration import parse_duration
from gateway.config.values.ranges import parse_ranges
from gateway.modbus.codes import Area
from gateway.profiles import shipped_text
from gateway.profiles.profile import Profile
from gateway.timing.table import Point, TimingTable


def builtin_profile(name: str) -> Profile:
    """Read the built-in profile `name`, with the same result as `gateway.config`, but without its points."""
    table = tomllib.loads(shipped_text(name) or "")["profile"][name]
    functions = table.get("functions")
    points: dict[int, list[Point]] = {}
    for row in table.get("timing", ()):
        points.setdefault(row["fc"], []).append(Point(row["items"], parse_duration(row["time"])))
    return Profile(
        name=name,
        title=table["title"],
        functions=None if functions is None else frozenset(functions),
        limits={int(function): most for function, most in table.get("limits", {}).items()},
        areas={area: parse_ranges(table[area]) for area in Area if area in table},
        timing=TimingTable.of(points),
        timeout=parse_duration(table["timeout"]),
        quirks=frozenset(table.get("quirks", ())),
        **{key: table[key] for key in ("idle_chars", "margin") if key in table},
    )
