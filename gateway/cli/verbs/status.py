"""`status`: the state of the running gateway."""

import argparse
import json
import os
import shutil
import sys
import time
from typing import Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.terminal import redrawn, unescaped
from gateway.cli.main import FINE
from gateway.cli.show.fleet import SITES
from gateway.cli.show.status import show_status
from gateway.operator.operation import Nothing
from gateway.operator.operations import FLEET, STATUS

#: The interval of `-w`, in seconds.
_WATCH_STEP: Final = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `status`."""
    add_control_argument(parser)
    parser.add_argument("-w", "--watch", action="store_true", help="show it again every second, until Ctrl-C")
    parser.add_argument("--fleet", action="store_true", help="show all sites of the fleet instead of this gateway")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Print the gateway's status.

    Raises:
        DaemonError: no gateway answers.
    """
    in_place = args.watch and not args.json and sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    while True:
        columns, rows = shutil.get_terminal_size()
        text = _look(args, columns)
        if in_place:
            print(end=redrawn(text, rows), file=unescaped(sys.stdout), flush=True)
        else:
            print(text, end="\n\n" if args.watch and not args.json else "\n", flush=True)
        if not args.watch:
            return FINE
        time.sleep(_WATCH_STEP)


def _look(args: argparse.Namespace, width: int) -> str:
    """Ask for the status, or that of all sites, as it is printed."""
    with Conversation(which_gateway(args)) as daemon:
        if args.json:
            answer = daemon.ask_for_json(FLEET if args.fleet else STATUS, Nothing())
            told = {"sites": answer["sites"]} if args.fleet else answer["status"]
            return json.dumps(told, indent=None if args.watch else 2)
        if args.fleet:
            return SITES.show(daemon.ask(FLEET, Nothing()), width)
        is_cut = sys.stdout.isatty() or "COLUMNS" in os.environ
        return show_status(daemon.ask(STATUS, Nothing()), width, is_cut=is_cut)
