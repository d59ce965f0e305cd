"""`map`: the registers of a unit as the config says them, for those who set up its clients."""

import argparse
import json
import os
import sys
from pathlib import Path

from gateway.cli.kit.daemon import CONTROL_VARIABLE, Conversation, which_gateway
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.cli.show.map import Ages, map_as_csv, map_as_json, map_as_text
from gateway.cli.show.register_map import RegisterMap, register_map, units_with_maps
from gateway.config.load import load
from gateway.config.plan.settings import Plan
from gateway.config.problem import did_you_mean, errors_in
from gateway.errors import DaemonError
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.table import WHICH


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `map`."""
    let_options_stand_anywhere(parser)
    add = parser.add_argument
    add("unit", metavar="UNIT", help="a virtual unit, image, mirror, or device with points: its number or its name")
    add("--config", metavar="FILE", help=f"the config file (default: that of the gateway, else {DEFAULT_CONFIG})")
    add("--control", metavar="PATH", help=f"control socket of the gateway that is meant (default: ${CONTROL_VARIABLE})")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--csv", action="store_true", help="print CSV, for the one who sets up the PLC or SCADA")
    output.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """Print the map of a unit; 1 if the config has errors, 2 if there is no such unit, or nothing is known of it."""
    file = _config(args)
    loaded = load(file)
    if loaded.plan is None:
        print(*errors_in(loaded.problems), sep="\n", file=sys.stderr)
        return PROBLEM_FOUND
    found = _find(args.unit, loaded.plan)
    if args.csv:
        sys.stdout.write(map_as_csv(found))
        return FINE
    ages = _ages(found, args, file)
    if args.json:
        print(json.dumps(map_as_json(found, ages), indent=2, ensure_ascii=False))
    else:
        print(map_as_text(found, ages))
    return FINE


def _config(args: argparse.Namespace) -> str:
    """Return the config file that is named, else that of the gateway that is named, else the usual one.

    Raises:
        DaemonError: the gateway that is named does not tell its config.
    """
    if args.config or not (args.control or os.environ.get(CONTROL_VARIABLE)):
        return args.config or DEFAULT_CONFIG
    with Conversation(which_gateway(args)) as daemon:
        return daemon.ask(WHICH, Nothing()).config


def _find(unit: str, plan: Plan) -> RegisterMap:
    """Make the map of the unit with a number or a name."""
    known = units_with_maps(plan)
    by_number = {str(number): name for name, number in known.items() if number is not None}
    name = unit if unit in known else by_number.get(unit)
    if name is None:
        raise WrongUsageError(f'there is no unit "{unit}" in the config', did_you_mean(unit, known))
    found = register_map(plan, name)
    if not found.rows:
        remedy = "give points to its profile, or to the device itself, in the config"
        raise WrongUsageError(f"{name} has no points, which say what its registers mean", remedy)
    return found


def _ages(found: RegisterMap, args: argparse.Namespace, config: str) -> Ages | None:
    """Ask the gateway that runs with `config` how old the values are; None, after a note why, if it does not tell."""
    if all(row.line.every is None for row in found.rows):
        return None
    try:
        meant = which_gateway(args)
        if not args.control and not args.config:
            meant = meant._replace(config=Path(config))
        with Conversation(meant) as daemon:
            return Ages(daemon, found)
    except DaemonError as error:
        print(f"without ages: {error}", file=sys.stderr)
        return None
