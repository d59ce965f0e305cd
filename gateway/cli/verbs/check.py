"""`check`: the problems of a config file, and its effect."""

import argparse
import json
import shutil
from functools import partial
from pathlib import Path

from gateway.cli.kit.progress import working
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.cli.show.check import check_as_json, check_as_text
from gateway.cli.show.quotes import Quotes
from gateway.config.documents.json_schema import json_schema
from gateway.config.load import Loaded, load
from gateway.config.machine.file_text import folder_of
from gateway.config.machine.troubles import address_trouble
from gateway.config.machine.unit_class import unit_trouble
from gateway.config.plan.settings import Plan
from gateway.control.path import folder_of_control
from gateway.readconfig.file_troubles import with_file_troubles


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `check`."""
    parser.add_argument("config", nargs="?", default=DEFAULT_CONFIG, help=f"the config file (default {DEFAULT_CONFIG})")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print JSON instead of tables")
    output.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of config files for an editor, and read no file"
    )


def run(args: argparse.Namespace) -> int:
    """Print every problem, and the effect of a file without errors; 1 if there is an error."""
    if args.schema:
        print(json.dumps(json_schema(), indent=1, ensure_ascii=False))
        return FINE
    with working(f"checking {args.config}"):
        loaded = _load_and_look(args.config)
        plan = loaded.plan
        text = _told(loaded, plan, args)
    print(text)
    return PROBLEM_FOUND if plan is None else FINE


def _told(loaded: Loaded, plan: Plan | None, args: argparse.Namespace) -> str:
    folder = folder_of_control(Path(args.config), None if plan is None else plan.control)
    if args.json:
        return json.dumps(check_as_json(loaded, plan, folder), indent=2, ensure_ascii=False)
    quotes = Quotes(args.config, loaded.text, shutil.get_terminal_size().columns, loaded.positions)
    return check_as_text(loaded, plan, folder, quotes.told)


def _load_and_look(file: str) -> Loaded:
    """Load the file, and add what would keep the service of this machine from using it."""
    made = partial(unit_trouble, folder=folder_of(Path(file)))
    return with_file_troubles(load(file, address_trouble=address_trouble, unit_trouble=made), file)
