"""`bench`: what a line can carry by arithmetic, and what it carries in a minute of reads."""

import argparse
import json
from dataclasses import asdict

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.progress import progress
from gateway.cli.kit.usage import number_of, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.cli.show.bench import show_bench
from gateway.config.values.duration import parse_duration, show_duration
from gateway.errors import DaemonError
from gateway.operator.operations.answers.bench import BenchResult
from gateway.operator.operations.asked import ToMeasure
from gateway.operator.operations.table import BENCH

#: A client's reads may wait this long behind the end of the measurement, in seconds.
_SLACK = 40.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `bench`."""
    add = parser.add_argument
    add("line", metavar="LINE", help="name of the line")
    add("--unit", metavar="UNIT", help="read one unit, by number or name (default: all of the line in turn)")
    add(
        "--items",
        type=number_of("a valid number of items", 10),
        default=10,
        metavar="N",
        help="registers or coils of each read (default 10)",
    )
    add("--at", type=_address, metavar="ADDRESS", help="first address (default: one that the profile names, or 0)")
    add("--for", dest="seconds", type=parsed_by(parse_duration), default=60.0, metavar="TIME",
        help='how long to measure, such as "10 s" (default 1 min)')  # fmt: skip
    add_control_argument(parser)
    add("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Measure, and print both rates; 1 when a read failed.

    Raises:
        DaemonError: no gateway answers, or it cannot read there.
    """
    unit = int(args.unit) if args.unit is not None and args.unit.isdecimal() else args.unit
    with Conversation(which_gateway(args)) as daemon:
        daemon.wait_for(args.seconds + _SLACK)
        asked = ToMeasure(args.line, unit, args.seconds, args.items, args.at, progress=True)
        result = _measure(daemon, asked)
    print(json.dumps(asdict(result), indent=2, ensure_ascii=False) if args.json else show_bench(result))
    return PROBLEM_FOUND if result.failed else FINE


def _measure(daemon: Conversation, asked: ToMeasure) -> BenchResult:
    """Wait for the result, and show on a terminal how far the measurement is."""
    with progress() as line:
        for step in daemon.answers(BENCH, asked):
            if step.bench is not None:
                return step.bench
            if step.progress is not None:
                done = step.progress
                line.show(f"{done.elapsed_s:.0f} of {show_duration(asked.seconds)}, {done.reads} reads")
    raise DaemonError("the gateway's answer has no measurement in it")


def _address(text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}" is not an address; write a number such as 107') from None
