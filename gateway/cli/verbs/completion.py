"""`completion`: lets a shell complete commands, options and their values.

The scripts are made by deploy/completions.py.
"""

import argparse
from importlib import resources
from typing import Final

from gateway.cli.main import FINE

#: The scripts by the shells that read them, under the names by which these find them.
SCRIPTS: Final = {"bash": "modbus-gateway", "zsh": "_modbus-gateway", "fish": "modbus-gateway.fish"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument("shell", choices=tuple(SCRIPTS), help="the shell that reads it")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    script = resources.files("gateway.cli") / "completions" / SCRIPTS[args.shell]
    print(script.read_text(encoding="utf-8"), end="")
    return FINE
