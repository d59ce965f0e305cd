"""`status`: how the running gateway is doing."""

import argparse
import json
import time
from collections.abc import Callable, Mapping
from math import ceil
from typing import Any, Final

from gateway.cli.columns import align
from gateway.cli.daemon import UNKNOWN, add_control_argument, ask
from gateway.cli.main import FINE
from gateway.config.duration import show_duration
from gateway.errors import DaemonError
from gateway.lines.counts import RESULTS

#: How often `-w` looks, in seconds.
_WATCH_STEP: Final = 1.0
#: What makes a cell of the picture empty: nothing to tell.
_NOTHING: Final = "-"

#: A key of a row, or what makes its text of the row.
_Column = str | Callable[[Mapping[str, Any]], object]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `status`."""
    add_control_argument(parser)
    parser.add_argument("-w", "--watch", action="store_true", help="show it again every second, until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Print the daemon's status.

    Raises:
        DaemonError: no daemon answers.
    """
    while True:
        status = ask("status", args.control).get("status")
        if not isinstance(status, dict):
            raise DaemonError("the daemon's answer has no status in it")
        print(json.dumps(status, indent=None if args.watch else 2) if args.json else picture(status), flush=True)
        if not args.watch:
            return FINE
        time.sleep(_WATCH_STEP)
        if not args.json:
            print()


def picture(status: Mapping[str, Any]) -> str:
    """The status as tables."""
    units = _rows(status, "units")
    asked = [unit for unit in units or () if _cell(_was_asked, unit)]
    shown = {**status, "units": None if units is None else asked}
    parts = [_table(title, _rows(shown, section), columns) for title, section, columns in _TABLES]
    silent = len(units or ()) - len(asked)
    if silent:
        parts.append(f"{silent} units have not been asked yet.")
    return "\n\n".join(part for part in parts if part)


def _rows(status: Mapping[str, Any], section: str) -> list[Any] | None:
    """A section; None if this daemon has none."""
    rows = status.get(section)
    return rows if isinstance(rows, list) else None


def _table(title: str, rows: list[Any] | None, columns: Mapping[str, _Column]) -> str:
    if rows is None:
        return f"{title}\n  {UNKNOWN}"
    cells = [tuple(str(_cell(column, row)) for column in columns.values()) for row in rows]
    return f"{title}\n{align([tuple(columns), *cells], '  ')}" if cells else ""


def _cell(column: _Column, row: Any) -> object:
    """What stands in a column. Daemons of other versions may lack it, or tell it in another way."""
    try:
        return row[column] if isinstance(column, str) else column(row)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError):
        return UNKNOWN


def _was_asked(unit: Mapping[str, Any]) -> bool:
    return bool(unit["counts"]["sent"] or unit["state"] != "fine" or _count_failed(unit))


def _at(unit: Mapping[str, Any]) -> str:
    return f"{unit['line']}/{unit['on_the_wire']}"


def _unit_state(unit: Mapping[str, Any]) -> str:
    return f"rests {show_duration(ceil(unit['rests_ms'] / 1000))}" if unit["state"] == "resting" else str(unit["state"])


def _last_error(unit: Mapping[str, Any]) -> str:
    return str(unit["last_error"] or _NOTHING)


def _longest_wait(unit: Mapping[str, Any]) -> str:
    return show_duration(ceil(unit["longest_wait_ms"] / 10) / 100)


def _count_answered(server: Mapping[str, Any]) -> int:
    return int(server["counts"]["responses"])


def _ages(mirror: Mapping[str, Any]) -> str:
    return ", ".join(f"{each['addresses']}: {_age(each['age_ms'])}" for each in mirror["ranges"])


def _age(age: float | None) -> str:
    return "not known" if age is None else f"{age / 1000:.1f} s"


def _state(one: Mapping[str, Any]) -> str:
    return f"down: {one['reason']}" if one["state"] == "down" else str(one["state"])


def _count_ok(one: Mapping[str, Any]) -> int:
    """Requests that were answered by the device, exceptions included, and broadcasts."""
    counts = one["counts"]
    return int(counts["ok"] + counts["exception"] + counts["broadcast"])


def _count_failed(one: Mapping[str, Any]) -> int:
    """Requests that were not. A result that the daemon does not know has not happened there."""
    counts: Mapping[str, int] = one["counts"]
    return sum(counts.get(result, 0) for result in RESULTS) - _count_ok(one)


#: The tables: what each is called, the section of the status that it shows, and its columns.
_TABLES: Final[tuple[tuple[str, str, Mapping[str, _Column]], ...]] = (
    ("Listeners", "listeners", {"NAME": "name", "ADDRESS": "address", "CLIENTS": "clients", "REJECTED": "rejected"}),
    (
        "Lines",
        "lines",
        {
            "NAME": "name",
            "PORT": "port",
            "WIRE": "wire",
            "STATE": _state,
            "WAITING": "queue",
            "OK": _count_ok,
            "FAILED": _count_failed,
        },
    ),
    (
        "Server lines",
        "servers",
        {"NAME": "name", "PORT": "port", "WIRE": "wire", "STATE": _state, "ANSWERED": _count_answered},
    ),
    (
        "Upstreams",
        "upstreams",
        {
            "NAME": "name",
            "ADDRESS": "to",
            "STATE": _state,
            "WAITING": "queue",
            "OK": _count_ok,
            "FAILED": _count_failed,
        },
    ),
    (
        "Units",
        "units",
        {
            "UNIT": "unit",
            "AT": _at,
            "DEVICE": "name",
            "STATE": _unit_state,
            "OK": _count_ok,
            "FAILED": _count_failed,
            "LAST-ERROR": _last_error,
            "LONGEST-WAIT": _longest_wait,
        },
    ),
    ("Images", "images", {"UNIT": "unit", "NAME": "name", "REQUESTS": "requests", "EXCEPTIONS": "exceptions"}),
    ("Mirrors", "mirrors", {"UNIT": "unit", "NAME": "name", "OF": "of", "REQUESTS": "requests", "AGES": _ages}),
)
