"""`status`: the state of the running gateway."""

import argparse
import json
import os
import shutil
import sys
import time
from functools import partial
from typing import Any

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.kit.watching import WATCH_HELP, Screen, repeat, watch
from gateway.cli.main import FINE
from gateway.cli.show.fleet import sites_as_text
from gateway.cli.show.status import show_status, status_screen
from gateway.operator.fleet.sites import today
from gateway.operator.fleet.sites_csv import sites_as_csv
from gateway.operator.operations.answers.status import Sites, Status
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.table import FLEET, STATUS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `status`."""
    add_control_argument(parser)
    parser.add_argument("-w", "--watch", action="store_true", help=WATCH_HELP)
    parser.add_argument("--fleet", action="store_true", help="show all sites of the fleet instead of this gateway")
    parser.add_argument("--all", action="store_true", help="with --fleet: of many sites, list those that are fine too")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of tables")
    output.add_argument("--csv", action="store_true", help="with --fleet: print CSV, with all that is known of a site")


def run(args: argparse.Namespace) -> int:
    """Print the gateway's status."""
    if (args.csv or args.all) and not args.fleet:
        raise WrongUsageError(f"--{'csv' if args.csv else 'all'} needs --fleet")
    if args.csv:
        repeat(lambda: _csv(args), is_watched=args.watch)
    elif args.json:
        repeat(lambda: json.dumps(_ask_for_json(args), indent=None if args.watch else 2), is_watched=args.watch)
    elif args.watch:
        watch(lambda: _ask(args), partial(_screen, args))
    else:
        print(_text(args, _ask(args)))
    return FINE


def _ask(args: argparse.Namespace) -> Status | Sites:
    with Conversation(which_gateway(args)) as daemon:
        return daemon.ask(FLEET, Nothing()) if args.fleet else daemon.ask(STATUS, Nothing())


def _ask_for_json(args: argparse.Namespace) -> Any:
    with Conversation(which_gateway(args)) as daemon:
        answer = daemon.ask_for_json(FLEET if args.fleet else STATUS, Nothing())
        return {"sites": answer["sites"]} if args.fleet else answer["status"]


def _csv(args: argparse.Namespace) -> str:
    told = _ask(args)
    return sites_as_csv(told.sites).rstrip("\n") if isinstance(told, Sites) else ""


def _sites(args: argparse.Namespace, told: Sites, width: int) -> str:
    return sites_as_text(told, today(time.time()), width, shows_all=args.all)


def _text(args: argparse.Namespace, told: Status | Sites) -> str:
    """Show it below what was printed before; names are whole where nobody sees the edge of the terminal."""
    columns = shutil.get_terminal_size().columns
    if isinstance(told, Sites):
        return _sites(args, told, columns)
    return show_status(told, columns, is_cut=sys.stdout.isatty() or "COLUMNS" in os.environ)


def _screen(args: argparse.Namespace, told: Status | Sites, width: int, part: str) -> Screen:
    """Make the screen of `-w`."""
    if isinstance(told, Sites):
        return Screen(_sites(args, told, width).splitlines())
    return status_screen(told, width, part)
