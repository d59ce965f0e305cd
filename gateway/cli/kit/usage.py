"""Wrong arguments: what is wrong with them, and what to type instead."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any

from gateway.cli.kit.paint import red
from gateway.cli.main import WRONG_USAGE
from gateway.config.problem import WrongValue


class WrongUsageError(Exception):
    """The arguments are wrong. `remedy` is what to do instead, often a whole command."""

    def __init__(self, what: str, remedy: str = "") -> None:
        super().__init__(what)
        self.remedy = remedy


def tell_wrong_usage(wrong: WrongUsageError) -> int:
    """Print the error; returns the exit code."""
    print(f"modbus-gateway: {red('error')}: {wrong}", file=sys.stderr)
    if wrong.remedy:
        print(f"  help: {wrong.remedy}", file=sys.stderr)
    return WRONG_USAGE


def parsed_by(parse: Callable[[object], Any]) -> Callable[[str], Any]:
    """Make a `type` for argparse from a function that parses values of the config."""

    def argument(text: str) -> Any:
        try:
            return parse(text)
        except WrongValue as wrong:
            remedy = f": {wrong.remedy}" if wrong.remedy else ""
            raise argparse.ArgumentTypeError(f"{wrong}{remedy}") from wrong

    return argument


def count(text: str) -> int:
    """Parse how many times, at least 1: a `type` for argparse.

    Raises:
        argparse.ArgumentTypeError: it is no such number.
    """
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'"{text}" is not a number of times; write one such as 10')
    return int(text)


def baud(text: str) -> int:
    """Parse the rate of a line: a `type` for argparse.

    Raises:
        argparse.ArgumentTypeError: it is no such number.
    """
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'"{text}" is not a valid rate; write a number such as 9600')
    return int(text)


def add_port_arguments(group: Any, what: str) -> None:
    """Add the arguments that name a port without a gateway, and how its line is set; `what` is done with it."""
    add = group.add_argument
    add("--port", metavar="PORT", help=f"{what} this serial port: /dev/ttyUSB0, or rtu+tcp://host:port")
    add("--baud", type=baud, default=19200, metavar="N", help="its rate (default 19200)")
    add("--format", metavar="F", help="its character format (default 8E1, ASCII 7E1)")
    add("--mode", choices=("rtu", "ascii"), help="the protocol on the line (default rtu)")


def let_options_stand_anywhere(parser: argparse.ArgumentParser) -> None:
    """Allow options between words: argparse would reject the words after an option."""
    plain = parser.parse_known_args

    def parse(args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        setattr(parser, "parse_known_args", plain)  # noqa: B010 - called below
        return parser.parse_known_intermixed_args(args, namespace)

    setattr(parser, "parse_known_args", parse)  # noqa: B010 - a method of one parser
