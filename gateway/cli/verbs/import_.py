"""`import`: a config out of the files of another program."""

import argparse
import sys
from typing import Final

from gateway.cli.kit.usage import WrongUsageError, tell_wrong_usage
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.importing.from_mbusd import config_from_mbusd
from gateway.config.importing.from_modbus_proxy import config_from_modbus_proxy
from gateway.config.importing.imported import read_file

_PROGRAMS: Final = ("mbusd", "modbus-proxy")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `import`."""
    parser.add_argument("program", choices=_PROGRAMS, help="the program whose config it is")
    parser.add_argument("files", nargs="+", metavar="FILE", help="its config; mbusd has one for each serial port")


def run(args: argparse.Namespace) -> int:
    """Print a config that does the same, and say what is left out of it; 1 if something is.

    Raises:
        ImportedFileError: no file can be read and understood.
    """
    if args.program == "modbus-proxy" and len(args.files) > 1:
        return tell_wrong_usage(WrongUsageError("modbus-proxy has one file", "import each of them by itself"))
    if args.program == "mbusd":
        imported = config_from_mbusd(args.files)
    else:
        (file,) = args.files
        imported = config_from_modbus_proxy(file, read_file(file))
    print(imported.text, end="")
    for each in imported.left_out:
        print(f"modbus-gateway: error: left out: {each}", file=sys.stderr)
    return PROBLEM_FOUND if imported.left_out else FINE
