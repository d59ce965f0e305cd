"""`values`: the latest known values of all points, without asking a device."""

import argparse
import json
import shutil
import sys
from dataclasses import replace
from typing import Final

from gateway.cli.kit.columns import align, narrow
from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.paint import dim, red, yellow
from gateway.cli.kit.usage import let_options_stand_anywhere, number_or_name
from gateway.cli.kit.watching import WATCH_HELP, Screen, repeat, watch
from gateway.cli.main import FINE
from gateway.config.values.duration import show_age
from gateway.operator.operations.answers.known_values import KnownValue, KnownValues
from gateway.operator.operations.asked import KnownOf
from gateway.operator.operations.table import VALUES
from gateway.operator.values.values_csv import values_as_csv

_HEADINGS: Final = ("DEVICE", "POINT", "VALUE", "UNIT", "STATE", "AGE", "SOURCE")
#: The columns that may be shortened.
_FLEXIBLE: Final = (0, 1, 2, 6)
#: From this age on tenths of a second do not matter, in milliseconds.
_LONG: Final = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `values`."""
    let_options_stand_anywhere(parser)
    add_control_argument(parser)
    parser.add_argument(
        "unit",
        nargs="?",
        type=number_or_name,
        metavar="UNIT|NAME",
        help="only those of this device: its number or name",
    )
    parser.add_argument("-w", "--watch", action="store_true", help=WATCH_HELP)
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of a table")
    output.add_argument("--csv", action="store_true", help="print CSV; its columns are always the same")


def run(args: argparse.Namespace) -> int:
    """Print what is known of the points."""
    if args.json or args.csv:
        repeat(lambda: _for_programs(args), is_watched=args.watch)
    elif args.watch:
        watch(lambda: _ask(args), _screen)
    else:
        # Where nobody sees a screen, names are not shortened: grep finds them.
        columns = shutil.get_terminal_size((0, 0)).columns or sys.maxsize
        print(values_as_text(_ask(args), columns))
    return FINE


def _ask(args: argparse.Namespace) -> KnownValues:
    with Conversation(which_gateway(args)) as daemon:
        return daemon.ask(VALUES, KnownOf(args.unit))


def _for_programs(args: argparse.Namespace) -> str:
    if args.csv:
        return values_as_csv(_ask(args).values).rstrip("\n")
    with Conversation(which_gateway(args)) as daemon:
        answer = daemon.ask_for_json(VALUES, KnownOf(args.unit))
        told = {name: answer[name] for name in ("values", "hint")}
        return json.dumps(told, indent=None if args.watch else 2, ensure_ascii=False)


def _screen(known: KnownValues, width: int, device: str) -> Screen:
    """Make the screen of `-w`, of all devices or of one."""
    devices = list(dict.fromkeys(each.name for each in known.values))
    shown = [each for each in known.values if device in ("", each.name)]
    return Screen(values_as_text(replace(known, values=shown), width).splitlines(), parts=devices)


def values_as_text(known: KnownValues, width: int) -> str:
    """Show values for people, `width` characters wide unless they are too long; and what to do if there is none."""
    rows = [_HEADINGS, *(_row(each) for each in known.values)]
    table = align(narrow(rows, _FLEXIBLE, width)) if known.values else ""
    return "\n".join(filter(None, (table, known.hint))) or "no point can be read here: see the rows of [[access]]"


def _row(each: KnownValue) -> tuple[str, ...]:
    return (
        each.name,
        each.point,
        each.text,
        each.measure or "",
        _painted(each.state),
        _age(each.age_ms),
        each.source or "",
    )


def _painted(state: str) -> str:
    return {"invalid": red, "stale": yellow, "never": dim}.get(state, str)(state)


def _age(age_ms: float | None) -> str:
    if age_ms is None:
        return ""
    return f"{age_ms / 1000:.1f} s" if age_ms < _LONG else show_age(age_ms)
