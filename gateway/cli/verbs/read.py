"""`read`: values of a unit, by area and address or by the names of its points."""

import argparse
import itertools
import sys
import time
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Final

from gateway.cli.kit.paint import red
from gateway.cli.kit.usage import count, let_options_stand_anywhere, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.units.mbpoll import add_habits
from gateway.cli.units.on_unit import carry_out, run_on_unit
from gateway.cli.units.unit import NoResponseError, Unit, add_unit_arguments
from gateway.cli.units.values import as_json, failure_in_words, frames_as_json, frames_as_text, picture, table
from gateway.cli.units.words import Command, find_points
from gateway.config.values.duration import parse_duration
from gateway.operator.values.steps import Outcome, reading
from gateway.profiles.point import NO_VALUE, Point

#: How often to read when only the number of times is said, in seconds.
_USUAL_PACE: Final = 1.0

#: What is said below a table that has a dash for a value.
_NO_VALUE: Final = f"{NO_VALUE} is no value: the device says that it has none, or the registers hold no number"

_ABOUT: Final = """\
UNIT is a unit number or the name of a device. AREA is coils, discrete, input or
holding. Addresses count from 0: 40001 is holding 0. TYPE is uint16, int16,
uint32, int32, uint64, int64, float32, float64, bcd16, bcd32 or string.

8.3 is bit 3 of register 8. A dash in place of a value: the device says that it
has none, or the registers hold no number.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `read`."""
    parser.usage = (
        "modbus-gateway read UNIT [POINT ...] [options]\n"
        "       modbus-gateway read UNIT AREA ADDRESS[-ADDRESS] [TYPE] [options]"
    )
    parser.epilog = _ABOUT
    add, duration = parser.add_argument, parsed_by(parse_duration)
    add("words", nargs="*", metavar="UNIT ...", help="the unit, and what to read from it: see the examples")
    add("-i", "--interval", type=duration, metavar="EVERY", help="read again and again, such as -i 1s")
    add("-n", "--count", type=count, metavar="COUNT", help="how many times (default: until Ctrl-C)")
    add_unit_arguments(parser)
    add_habits(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Read and print; 1 when a unit answers with an exception, 2 when it is not clear what is meant."""

    def act(unit: Unit, command: Command, words: Sequence[str]) -> int:
        points = find_points(command, words)
        is_once = args.interval is None and args.count is None
        return _show(unit, points, args) if is_once else _show_repeatedly(unit, points, args)

    return run_on_unit("read", args, act)


def _show(unit: Unit, points: Sequence[Point], args: argparse.Namespace) -> int:
    """Read once."""
    outcome = carry_out(unit, reading(points, unit.read_rules, unit.holes))
    if args.json:
        print(as_json(_picture(unit, points, outcome, args), one_line=False))
    else:
        _print(unit, outcome, args, table(outcome.readings))
        if any(each.value is None for each in outcome.readings):
            print(_NO_VALUE, file=sys.stderr)
    return PROBLEM_FOUND if outcome.failures else FINE


def _show_repeatedly(unit: Unit, points: Sequence[Point], args: argparse.Namespace) -> int:
    """Read again and again. No response is no reason to end: there may be one next time."""
    code, shown = FINE, ""
    for now in _times(args.interval or _USUAL_PACE, args.count):
        try:
            outcome = carry_out(unit, reading(points, unit.read_rules, unit.holes))
        except NoResponseError as error:
            print(f"{now:%H:%M:%S}  {red(str(error))}", file=sys.stderr, flush=True)
            code = PROBLEM_FOUND
            continue
        code = PROBLEM_FOUND if outcome.failures else code
        if args.json:
            at = {"time": now.isoformat("T", "milliseconds")}
            print(as_json({**at, **_picture(unit, points, outcome, args)}, one_line=True), flush=True)
            continue
        headings, _, rows = table(outcome.readings, now.time().isoformat("milliseconds")).partition("\n")
        _print(unit, outcome, args, rows if headings == shown else f"{headings}\n{rows}")
        shown = headings if outcome.readings else shown
    return code


def _times(pace: float, count: int | None) -> Iterator[datetime]:
    """Times to read, `pace` seconds apart; what is late is not made up for."""
    due = time.monotonic()
    for _ in itertools.count() if count is None else range(count):
        time.sleep(max(0.0, due - time.monotonic()))
        yield datetime.now().astimezone()
        due = max(due + pace, time.monotonic())


def _picture(unit: Unit, points: Sequence[Point], outcome: Outcome, args: argparse.Namespace) -> dict[str, object]:
    frames = {"frames": frames_as_json(outcome.answers)} if args.raw else {}
    return {**picture(unit, None if points[0].name else points[0].area, outcome), **frames}


def _print(unit: Unit, outcome: Outcome, args: argparse.Namespace, text: str) -> None:
    if args.raw:
        print(frames_as_text(outcome.answers))
    if outcome.readings:
        print(text, flush=True)
    for failure in outcome.failures:
        print(failure_in_words(unit, failure), file=sys.stderr, flush=True)
