"""`write`: values to a unit, by area and address or by the name of a point."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from gateway.cli.kit.daemon import NOT_UNDERSTOOD, tell_which
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.units.mbpoll import add_habits
from gateway.cli.units.on_unit import run_on_unit
from gateway.cli.units.reading import read_points
from gateway.cli.units.unit import Unit, add_unit_arguments
from gateway.cli.units.values import as_json, failure_in_words, frames_as_json, frames_as_text, picture, table
from gateway.cli.units.words import Assignment, Command, find_assignments
from gateway.errors import DoesNotFit, ExceptionCode, GatewayError
from gateway.modbus.codes import FunctionCode
from gateway.operator.values import Answer, Failure, Outcome, request_to_write
from gateway.profiles.reading import Reading
from gateway.registers.items import WRITERS

_EXAMPLES: Final = """\
examples:
  modbus-gateway write silo-1 zero take           a point, by one of its labels
  modbus-gateway write press register-40136 926 --show
  modbus-gateway write 46 holding 135 0x039E      one register: function 06
  modbus-gateway write 46 holding 135 10 258      two registers: function 16
  modbus-gateway write 46 holding 10 -2.5 float32 --swap words
  modbus-gateway write 17 coils 172 on --port /dev/ttyUSB0 --baud 9600
  modbus-gateway write 1 holding 0 7 --tcp 10.1.0.5

UNIT is a unit number or the name of a device. AREA is coils or holding.
Addresses count from 0: 40001 is holding 0. TYPE is uint16, int16, uint32,
int32, uint64, int64, float32, float64 or string. It writes at once, without
asking.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `write`."""
    parser.usage = (
        "modbus-gateway write UNIT POINT VALUE [options]\n"
        "       modbus-gateway write UNIT AREA ADDRESS VALUE ... [TYPE] [options]"
    )
    parser.epilog = _EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "words", nargs="*", metavar="UNIT ...", help="the unit, and what to write to it: see the examples"
    )
    parser.add_argument("--show", action="store_true", help="read before and after, and show the old value too")
    parser.add_argument("--multiple", action="store_true", help="write one value with function 15 or 16 too")
    add_unit_arguments(parser)
    add_habits(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Write and print; 1 when the unit answers with an exception, 2 when what is meant is not clear or does not fit.

    Raises:
        GatewayError: the unit cannot be asked.
    """

    def act(unit: Unit, command: Command, words: Sequence[str]) -> int:
        wanted = _readings(find_assignments(command, words))
        if unit.gateway is not None:
            tell_which(unit.gateway)
        outcome = _write(unit, wanted, args)
        _print(unit, outcome, args)
        return PROBLEM_FOUND if outcome.failures else FINE

    return run_on_unit("write", args, act)


def _readings(assigned: Sequence[Assignment]) -> list[Reading]:
    """What is to be there afterwards.

    Raises:
        WrongUsageError: a point cannot hold its value.
    """
    try:
        return [Reading(point, point.items(text)) for point, text in assigned]
    except ValueError as wrong:
        raise WrongUsageError(str(wrong)) from wrong


def _write(unit: Unit, wanted: Sequence[Reading], args: argparse.Namespace) -> Outcome:
    """Write all values with one request; with --show they are read before and afterwards.

    Raises:
        WrongUsageError: they do not fit into one request.
    """
    points = [reading.point for reading in wanted]
    try:
        request, span = request_to_write(wanted, unit.limits, unit.functions, multiple=args.multiple)
    except DoesNotFit as wrong:
        raise WrongUsageError(wrong.what, wrong.remedy) from wrong
    is_shown = args.show and points[0].write != "only"
    before = read_points(unit, points) if is_shown else Outcome()
    with _noting("the write may have been carried out"):
        answer = unit.ask(request)
    if answer.exception is not None:
        failure = Failure(span, answer, _advice(answer, request))
        return Outcome([], [*before.failures, failure], [*before.answers, answer])
    with _noting("the write was carried out"):
        after = read_points(unit, points) if is_shown else Outcome(list(wanted))
    old = {id(reading.point): reading.items for reading in before.readings}
    return Outcome(
        [Reading(each.point, each.items, old.get(id(each.point))) for each in after.readings],
        [*before.failures, *after.failures],
        [*before.answers, answer, *after.answers],
    )


@contextmanager
def _noting(what: str) -> Iterator[None]:
    """An error in this context says also what became of the write."""
    try:
        yield
    except (GatewayError, *NOT_UNDERSTOOD) as error:
        error.add_note(what)
        raise


def _advice(answer: Answer, request: bytes) -> str:
    """What else can be tried. A gateway on the way, such as that of another site, refuses with 01 as a device does."""
    if answer.result == "denied":
        return "modbus-gateway check shows the rights"
    if answer.exception != ExceptionCode.ILLEGAL_FUNCTION or answer.result == "refused":  # which says why
        return ""
    rights = "this client may not write there: modbus-gateway check, on each gateway on the way, shows the rights"
    singles = {single: several for single, several, _ in WRITERS.values()}
    several = singles.get(FunctionCode(request[0]))
    if several is None:
        return f"the unit does not know function {request[0]:02}, or {rights}"
    return f"{rights}; if the unit does not know function {request[0]:02}: --multiple writes with {several:02}"


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
