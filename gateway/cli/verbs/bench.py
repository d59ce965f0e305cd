"""`bench`: what a line can carry by arithmetic, and what it carries in a minute of reads."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.progress import progress
from gateway.cli.kit.usage import number_of, number_or_name, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.values.duration import parse_duration, show_duration
from gateway.config.values.unitset import show_unit
from gateway.errors import DaemonError
from gateway.operator.operations.answers.bench import BenchResult
from gateway.operator.operations.asked import ToMeasure
from gateway.operator.operations.table import BENCH

#: A client's reads may wait this long behind the end of the measurement, in seconds.
_SLACK = 40.0
#: A difference between both rates that deserves a word.
_CLOSE: Final = 0.03


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `bench`."""
    add = parser.add_argument
    add("line", metavar="LINE", help="name of the line")
    add(
        "--unit",
        type=number_or_name,
        metavar="UNIT",
        help="read one unit, by number or name (default: all of the line in turn)",
    )
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
    """Measure, and print both rates; 1 when a read failed."""
    with Conversation(which_gateway(args)) as daemon:
        daemon.wait_for(args.seconds + _SLACK)
        asked = ToMeasure(args.line, args.unit, args.seconds, args.items, args.at, progress=True)
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


def show_bench(result: BenchResult) -> str:
    """Show a measurement as tables and notes."""
    reads = [
        (show_unit(one.unit), one.name, f"{one.area} {one.address}", str(one.items), _ms(one.line_time_ms))
        for one in result.reads
    ]
    expected, measured = result.expected_per_second, result.measured_per_second
    rates = [("by arithmetic", *_rate(expected)), ("measured", *_rate(measured))]
    parts = [
        f"Line {result.line}",
        align([("UNIT", "DEVICE", "READS FROM", "ITEMS", "LINE TIME"), *reads], "  "),
        align([("", "READS/S", "TIME OF A READ"), *rates], "  "),
        *(f"  {note}" for note in _notes(result)),
    ]
    return "\n".join(parts)


def _notes(result: BenchResult) -> Iterator[str]:
    total = result.answered + result.exceptions + result.failed
    expected = result.expected_per_second
    share = result.measured_per_second / expected if expected else None
    yield (
        f"{total} reads in {show_duration(result.seconds)}: {result.answered} answered, "
        f"{result.exceptions} exceptions, {result.failed} failed; line busy {result.busy_share:.0%}"
    )
    if result.left_out:
        yield f"left out, because they rest after several failures: {', '.join(result.left_out)}"
    if share is not None:
        yield f"measured is {share:.1%} of the arithmetic"
    if result.failed:
        yield f"the last failure: {result.last_failure}; modbus-gateway doctor {result.line} looks for the cause"
    if result.exceptions:
        yield "exceptions are shorter than answers: choose registers that exist, with --at and --items"
    if result.others:
        yield f"other clients had {result.others} requests on the line meanwhile"
    if (share is None or abs(share - 1) > _CLOSE) and not all(one.answer_time_known for one in result.reads):
        yield "the profile has no answer times, so the arithmetic has none: see modbus-gateway calibrate"


def _rate(per_second: float | None) -> tuple[str, str]:
    """Show reads in a second, and the time of one."""
    each = _ms(1000 / per_second) if per_second else "-"
    return "-" if per_second is None else f"{per_second:.2f}", each


def _ms(milliseconds: float) -> str:
    return f"{milliseconds:.1f} ms"
