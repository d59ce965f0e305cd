"""`import`: a config out of the files of another program, or a profile out of a table of registers."""

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Final

from gateway.cli.kit.paint import red, yellow
from gateway.cli.kit.progress import working
from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.importing.from_csv.profile import profile_from_csv
from gateway.config.importing.from_home_assistant.config import config_from_home_assistant
from gateway.config.importing.from_mbusd import config_from_mbusd
from gateway.config.importing.from_modbus_proxy import config_from_modbus_proxy
from gateway.config.importing.imported import Imported, read_bytes, read_file
from gateway.config.load import parse
from gateway.config.problem import Problem

_PROGRAMS: Final = ("mbusd", "modbus-proxy", "csv", "home-assistant")
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}", re.IGNORECASE)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `import`."""
    parser.add_argument("program", choices=_PROGRAMS, help="the program whose config it is; csv: a table of registers")
    parser.add_argument("files", nargs="+", metavar="FILE", help="its config; mbusd has one for each serial port")
    parser.add_argument("--name", metavar="NAME", help="csv: the name of the profile, such as maker-kind")


def run(args: argparse.Namespace) -> int:
    """Print what becomes of it, and say what is left out; 1 if something is."""
    _check_usage(args)
    with working("reading"):
        imported = _imported(args)
    print(imported.text, end="")
    for each in imported.notes:
        print(f"modbus-gateway: {yellow('note')}: {each}", file=sys.stderr)
    for each in imported.left_out:
        print(f"modbus-gateway: {red('error')}: left out: {each}", file=sys.stderr)
    return PROBLEM_FOUND if imported.left_out else FINE


def _check_usage(args: argparse.Namespace) -> None:
    if args.program != "mbusd" and len(args.files) > 1:
        raise WrongUsageError(f"{args.program} has one file", "import each of them by itself")
    if (args.program == "csv") != (args.name is not None):
        what = "the profile needs a name" if args.program == "csv" else f"{args.program} has no name"
        raise WrongUsageError(what, "import csv registers.csv --name maker-kind")
    if args.name is not None and not _NAME.fullmatch(args.name):
        raise WrongUsageError(f'"{args.name}" is no name of a profile', "letters, digits, - and _, such as maker-kind")


def _imported(args: argparse.Namespace) -> Imported:
    if args.program == "mbusd":
        return config_from_mbusd(args.files)
    (file,) = args.files
    if args.program == "csv":
        return profile_from_csv(file, args.name, read_bytes(file), _problems)
    if args.program == "home-assistant":
        return config_from_home_assistant(file, _problems)
    return config_from_modbus_proxy(file, read_file(file))


def _problems(text: str) -> Sequence[Problem]:
    """Find the problems of a config. Its ports need not be on this machine."""
    return parse(text, port_trouble=lambda _: None).problems
