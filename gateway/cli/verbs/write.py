"""`write`: values to a unit, by area and address or by the name of a point."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any, Final

from gateway.cli.kit.daemon import tell_which
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.units.mbpoll import add_habits
from gateway.cli.units.on_unit import carry_out, run_on_unit
from gateway.cli.units.unit import Unit, add_unit_arguments
from gateway.cli.units.values import as_json, failure_in_words, frames_as_json, frames_as_text, picture, table
from gateway.cli.units.words import Command, find_assignments
from gateway.errors import DoesNotFit
from gateway.operator.values.steps import NewValues, Outcome, writing

_ABOUT: Final = """\
UNIT is a unit number or the name of a device. AREA is coils or holding.
Addresses count from 0: 40001 is holding 0. TYPE is uint16, int16, uint32,
int32, uint64, int64, float32, float64, bcd16, bcd32 or string. It writes at
once, without asking.

A point that is some bits of a register is written with function 22 if the
profile names it. Otherwise the gateway reads the register and writes it, and
no other write of the gateway comes between; with --port and --tcp any other
client may write between the two.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `write`."""
    parser.usage = (
        "modbus-gateway write UNIT POINT VALUE [options]\n"
        "       modbus-gateway write UNIT AREA ADDRESS VALUE ... [TYPE] [options]"
    )
    parser.epilog = _ABOUT
    parser.add_argument(
        "words", nargs="*", metavar="UNIT ...", help="the unit, and what to write to it: see the examples"
    )
    parser.add_argument("--show", action="store_true", help="read before and after, and show the old value too")
    parser.add_argument("--multiple", action="store_true", help="write one value with function 15 or 16 too")
    add_unit_arguments(parser)
    add_habits(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Write and print; 1 when the unit answers with an exception, 2 when what is meant is not clear or does not fit."""

    def act(unit: Unit, command: Command, words: Sequence[str]) -> int:
        assigned = find_assignments(command, words)
        points, texts = [each.point for each in assigned], [each.text for each in assigned]
        new = NewValues(points, texts, unit.limits, unit.functions, multiple=args.multiple)
        try:
            steps = writing(new, shows=args.show, has_turns=unit.gateway is not None)
        except DoesNotFit as wrong:
            raise WrongUsageError(wrong.what, wrong.remedy) from wrong
        if unit.gateway is not None:
            tell_which(unit.gateway)
        outcome = carry_out(unit, steps)
        _print(unit, outcome, args)
        return PROBLEM_FOUND if outcome.failures else FINE

    return run_on_unit("write", args, act)


def _print(unit: Unit, outcome: Outcome, args: argparse.Namespace) -> None:
    if args.json:
        first = next((each.point for each in outcome.readings), None)
        area = outcome.failures[0].span.area if first is None else None if first.name else first.area
        more: dict[str, Any] = {} if unit.gateway is None else {"through": str(unit.gateway)}
        more |= {"frames": frames_as_json(outcome.answers)} if args.raw else {}
        print(as_json({**picture(unit, area, outcome), **more}, one_line=False))
        return
    if args.raw:
        print(frames_as_text(outcome.answers))
    if outcome.readings:
        print(table(outcome.readings))
    for failure in outcome.failures:
        print(failure_in_words(unit, failure), file=sys.stderr)
