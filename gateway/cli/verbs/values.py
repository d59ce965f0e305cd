"""`values`: the latest known values of all points, without asking a device."""

import argparse
import json
import os
import shutil
import sys
import time
from typing import Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.terminal import redrawn, unescaped
from gateway.cli.kit.usage import let_options_stand_anywhere
from gateway.cli.main import FINE
from gateway.cli.show.known_values import values_as_text
from gateway.operator.asked import KnownOf
from gateway.operator.operations import VALUES
from gateway.operator.values_csv import values_as_csv

#: The interval of `-w`, in seconds.
_WATCH_STEP: Final = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `values`."""
    let_options_stand_anywhere(parser)
    add_control_argument(parser)
    parser.add_argument("unit", nargs="?", metavar="UNIT|NAME", help="only those of this device: its number or name")
    parser.add_argument("-w", "--watch", action="store_true", help="show them again every second, until Ctrl-C")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of a table")
    output.add_argument("--csv", action="store_true", help="print CSV; its columns are always the same")


def run(args: argparse.Namespace) -> int:
    """Print what is known of the points.

    Raises:
        DaemonError: no gateway answers, or it has no such device.
    """
    in_place = args.watch and not (args.json or args.csv) and sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    while True:
        columns, rows = shutil.get_terminal_size()
        text = _look(args, columns)
        if in_place:
            print(end=redrawn(text, rows), file=unescaped(sys.stdout), flush=True)
        else:
            print(text, flush=True)
        if not args.watch:
            return FINE
        time.sleep(_WATCH_STEP)


def _look(args: argparse.Namespace, width: int) -> str:
    """Ask for the values, as they are printed."""
    asked = KnownOf(int(args.unit) if args.unit and args.unit.isdecimal() else args.unit)
    with Conversation(which_gateway(args)) as daemon:
        if args.json:
            answer = daemon.ask_for_json(VALUES, asked)
            told = {name: answer[name] for name in ("values", "hint")}
            return json.dumps(told, indent=None if args.watch else 2, ensure_ascii=False)
        known = daemon.ask(VALUES, asked)
        return values_as_csv(known.values).rstrip("\n") if args.csv else values_as_text(known, width)
