"""Wrong arguments: what is wrong with them, and what to type instead."""

import argparse
from collections.abc import Callable, Sequence
from typing import Any

from gateway.config.problem import WrongValue


class WrongUsageError(Exception):
    """The arguments are wrong: any command may raise it. `remedy` is what to do instead, often a whole command."""

    def __init__(self, what: str, remedy: str = "") -> None:
        super().__init__(what)
        self.remedy = remedy


def parsed_by(parse: Callable[[object], Any]) -> Callable[[str], Any]:
    """Make a `type` for argparse from a function that parses values of the config."""

    def argument(text: str) -> Any:
        try:
            return parse(text)
        except WrongValue as wrong:
            remedy = f": {wrong.remedy}" if wrong.remedy else ""
            raise argparse.ArgumentTypeError(f"{wrong}{remedy}") from wrong

    return argument


def number_of(what: str, example: int) -> Callable[[str], int]:
    """Make a `type` for argparse from what a number, at least 1, is of."""

    def argument(text: str) -> int:
        if not text.isdecimal() or int(text) == 0:
            raise argparse.ArgumentTypeError(f'"{text}" is not {what}; write a number such as {example}')
        return int(text)

    return argument


def number_or_name(text: str) -> int | str:
    """Tell the number of a unit from the name of one: a `type` for argparse."""
    return int(text) if text.isdecimal() else text


count = number_of("a number of times", 10)
baud = number_of("a valid rate", 9600)


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
