"""The arguments of `doctor --hardware-report`, without what makes the report: `doctor` starts quickly."""

import argparse
from typing import Any

from gateway.cli.kit.usage import baud, parsed_by
from gateway.config.problem import WrongValue
from gateway.config.values.character_format import parse_format
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT
from gateway.timing.characters import CharacterFormat


def unit_number(text: str) -> int:
    """Parse a unit on a serial line: a `type` for argparse.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    if not text.isdecimal() or not FIRST_UNIT <= int(text) <= HIGHEST_UNIT:
        raise argparse.ArgumentTypeError(f'"{text}" is not a unit; units are {FIRST_UNIT} to {HIGHEST_UNIT}')
    return int(text)


def add_report_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the report."""
    group: Any = parser.add_argument_group("a report about an adapter")
    add = group.add_argument
    add("--hardware-report", metavar="PORT", help="test the adapter of this serial port, and print a report")
    add("--unit", type=unit_number, metavar="N", help="read this unit for it (default: nothing is sent)")
    add("--baud", type=baud, default=19200, metavar="N", help="the rate of the unit (default 19200)")
    usual = CharacterFormat(8, "E", 1)
    add("--format", type=parsed_by(_format), default=usual, metavar="F", help=f"its format (default {usual})")


def _format(text: object) -> CharacterFormat:
    format_ = parse_format(text)
    if format_.data_bits != 8:
        raise WrongValue(f"RTU needs 8 data bits, and {format_} has {format_.data_bits}")
    return format_
