"""`import`: a config out of the files of another program."""

import argparse
from typing import Final

from gateway.cli.main import FINE
from gateway.cli.usage import WrongUsageError, tell_wrong_usage
from gateway.config.from_mbusd import config_from_mbusd, read_files
from gateway.config.from_modbus_proxy import config_from_modbus_proxy

_PROGRAMS: Final = ("mbusd", "modbus-proxy")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `import`."""
    parser.add_argument("program", choices=_PROGRAMS, help="the program whose config it is")
    parser.add_argument("files", nargs="+", metavar="FILE", help="its config; mbusd has one for each serial port")


def run(args: argparse.Namespace) -> int:
    """Print a config that does the same.

    Raises:
        ImportedFileError: a file cannot be read or understood.
    """
    if args.program == "modbus-proxy" and len(args.files) > 1:
        return tell_wrong_usage(WrongUsageError("modbus-proxy has one file", "import each of them by itself"))
    texts = read_files(args.files)
    if args.program == "mbusd":
        print(config_from_mbusd(texts), end="")
    else:
        ((file, text),) = texts.items()
        print(config_from_modbus_proxy(file, text), end="")
    return FINE
