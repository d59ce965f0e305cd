"""`status`: how the running gateway is doing."""

import argparse
import json
import time
from collections.abc import Iterable, Mapping
from math import ceil
from typing import Any, Final

from gateway.cli.columns import aligned
from gateway.cli.daemon import add_control_argument, ask
from gateway.cli.main import FINE
from gateway.config.duration import show_duration
from gateway.lines.counts import RESULTS

#: How often `-w` looks, in seconds.
_WATCH_STEP: Final = 1.0
#: What makes a cell of the picture empty: nothing to tell.
_NOTHING: Final = "-"


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
        status = ask("status", args.control)["status"]
        print(json.dumps(status, indent=None if args.watch else 2) if args.json else picture(status), flush=True)
        if not args.watch:
            return FINE
        time.sleep(_WATCH_STEP)
        if not args.json:
            print()


def picture(status: Mapping[str, Any]) -> str:
    """The status as tables."""
    units = [unit for unit in status["units"] if unit["counts"]["sent"] or unit["state"] != "fine" or _failed(unit)]
    parts = [
        _table("Listeners", "NAME ADDRESS CLIENTS REJECTED", map(_listener, status["listeners"])),
        _table("Lines", "NAME PORT WIRE STATE WAITING OK FAILED", map(_line, status["lines"])),
        _table("Lines we are asked on", "NAME PORT WIRE STATE ANSWERED", map(_server, status["servers"])),
        _table("Upstreams", "NAME ADDRESS STATE WAITING OK FAILED", map(_upstream, status["upstreams"])),
        _table("Units", "UNIT AT DEVICE STATE OK FAILED LAST-ERROR LONGEST-WAIT", map(_unit, units)),
        _table("Images", "UNIT NAME REQUESTS EXCEPTIONS", map(_image, status["images"])),
        _table("Mirrors", "UNIT NAME OF REQUESTS AGES", map(_mirror, status["mirrors"])),
    ]
    silent = len(status["units"]) - len(units)
    if silent:
        parts.append(f"{silent} units have not been asked yet.")
    return "\n\n".join(part for part in parts if part)


def _table(title: str, headings: str, rows: Iterable[tuple[object, ...]]) -> str:
    cells = [tuple(map(str, row)) for row in rows]
    return f"{title}\n{aligned([headings.split(), *cells], '  ')}" if cells else ""


def _listener(one: Mapping[str, Any]) -> tuple[object, ...]:
    return one["name"], one["address"], one["clients"], one["rejected"]


def _line(one: Mapping[str, Any]) -> tuple[object, ...]:
    return one["name"], one["port"], one["wire"], _state(one), one["queue"], _ok(one), _failed(one)


def _server(one: Mapping[str, Any]) -> tuple[object, ...]:
    return one["name"], one["port"], one["wire"], _state(one), one["counts"]["responses"]


def _upstream(one: Mapping[str, Any]) -> tuple[object, ...]:
    return one["name"], one["to"], _state(one), one["queue"], _ok(one), _failed(one)


def _unit(one: Mapping[str, Any]) -> tuple[object, ...]:
    at = f"{one['line']}/{one['on_the_wire']}"
    state = f"rests {show_duration(ceil(one['rests_ms'] / 1000))}" if one["state"] == "resting" else one["state"]
    longest = show_duration(ceil(one["longest_wait_ms"] / 10) / 100)
    return one["unit"], at, one["name"], state, _ok(one), _failed(one), one["last_error"] or _NOTHING, longest


def _image(one: Mapping[str, Any]) -> tuple[object, ...]:
    return one["unit"], one["name"], one["requests"], one["exceptions"]


def _mirror(one: Mapping[str, Any]) -> tuple[object, ...]:
    ages = ", ".join(f"{each['addresses']}: {_age(each['age_ms'])}" for each in one["ranges"])
    return one["unit"], one["name"], one["of"], one["requests"], ages


def _age(age: float | None) -> str:
    return "not known" if age is None else f"{age / 1000:.1f} s"


def _state(one: Mapping[str, Any]) -> str:
    return f"down: {one['reason']}" if one["state"] == "down" else str(one["state"])


def _ok(one: Mapping[str, Any]) -> int:
    """Requests that were answered by the device, exceptions included, and broadcasts."""
    counts = one["counts"]
    return int(counts["ok"] + counts["exception"] + counts["broadcast"])


def _failed(one: Mapping[str, Any]) -> int:
    """Requests that were not."""
    counts: Mapping[str, int] = one["counts"]
    return sum(counts[result] for result in RESULTS) - _ok(one)
