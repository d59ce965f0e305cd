"""`scan`: which units answer on a line, by asking each number once."""

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.paint import red, yellow
from gateway.cli.kit.progress import progress
from gateway.cli.kit.usage import WrongUsageError, add_port_arguments, let_options_stand_anywhere, parsed_by
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.problem import WrongValue
from gateway.config.values.duration import parse_duration, show_duration
from gateway.config.values.unitset import parse_units
from gateway.errors import DaemonError
from gateway.operator.operations.answers.scan import Found, Progress, ScanStep
from gateway.operator.operations.asked import ToScan
from gateway.operator.operations.table import SCAN
from gateway.tools.signs import OTHERS

#: The time limit of a question, in seconds, when nobody says otherwise.
_USUAL_LIMIT: Final = 0.3
#: The most SunSpec models in a row of the table.
_MOST_MODELS: Final = 12
#: A gateway without idle time on the line says so within a minute.
_LONGEST_SILENCE: Final = 70.0

_ABOUT: Final = """\
Through the gateway, scan uses the idle time of the line: a client waits for at
most one request of the scan. With --port, no gateway may have the port open.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `scan`."""
    parser.usage = (
        "modbus-gateway scan LINE [UNITS] [options]\n       modbus-gateway scan [UNITS] --port PORT [options]"
    )
    parser.epilog = _ABOUT
    add = parser.add_argument
    add("words", nargs="*", metavar="LINE [UNITS]", help="which line of the config; which units, such as 1-32 or 1,5,0")
    add("--all-speeds", action="store_true", help="try all usual rates; the line must not be in use")
    add(
        "--timeout",
        type=parsed_by(parse_duration),
        default=_USUAL_LIMIT,
        metavar="TIME",
        help="of each request (default 300ms)",
    )
    add("--json", action="store_true", help="print JSON instead of a table")
    add_control_argument(parser)
    direct = parser.add_argument_group("without a gateway")
    add_port_arguments(direct, "scan")
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Scan and print who was found; 1 when nobody was, or two devices have one address."""
    with ExitStack() as parts:
        line = parts.enter_context(progress())

        def tell(step: Progress) -> None:
            line.show(_how_far(step))

        if args.port:
            # Only here parts of a gateway are needed.
            from gateway.cli.units.direct_scan import scan_port  # noqa: PLC0415
            from gateway.clock.exact_loop import run_exactly  # noqa: PLC0415

            result = run_exactly(scan_port(args, _units(args.words), tell))
        else:
            result = _ask_daemon(args, parts, tell)
    found = result.found or ()
    print(json.dumps(_as_json(result, args), indent=2) if args.json else _as_text(result, found, args))
    return FINE if found and all(each.result != "garbled" for each in found) else PROBLEM_FOUND


def _ask_daemon(args: argparse.Namespace, parts: ExitStack, tell: Callable[[Progress], None]) -> ScanStep:
    if not args.words or len(args.words) > 2:
        raise WrongUsageError("which line?", "modbus-gateway scan LINE [UNITS], or --port for a port without a gateway")
    line, *units = args.words
    daemon = parts.enter_context(Conversation(which_gateway(args)))
    wanted = _units(units)
    daemon.wait_for(_LONGEST_SILENCE)
    for step in daemon.answers(SCAN, ToScan(line, wanted, args.timeout, args.all_speeds)):
        if step.found is not None:
            return step
        if step.progress is not None:
            tell(step.progress)
    raise DaemonError("the gateway's answer has no result of a scan in it")


def _units(words: Sequence[str]) -> list[str] | None:
    """Parse the unit set that the words name; None for all."""
    units = [part.strip() for word in words for part in word.split(",")]
    try:
        return [str(unit) for unit in parse_units(units, first=0)] if units else None
    except WrongValue as wrong:
        raise WrongUsageError(str(wrong), wrong.remedy or "write units such as 1-32 or 1,5") from wrong


def _how_far(progress: Progress) -> str:
    found = ", ".join(map(str, progress.found)) or "none yet"
    left = "almost done" if progress.left_s < 1 else f"{show_duration(round(progress.left_s))} left"
    return f"{progress.asked} of {progress.of} at {progress.baud} baud, {left}, found: {found}"


def _as_json(result: ScanStep, args: argparse.Namespace) -> dict[str, Any]:
    more = {} if args.port else {"known": result.known, "is_answered": result.is_answered}
    return {"asked": result.asked, "found": [asdict(each) for each in result.found or ()], **more}


def _as_text(result: ScanStep, found: Sequence[Found], args: argparse.Namespace) -> str:
    silent = result.asked - len({each.unit for each in found})
    parts = []
    if found:
        headings = ("UNIT", "RESULT", "ANSWER", "PROFILE", *(("BAUD",) if args.all_speeds else ()))
        parts.append(align([headings, *(_cells(each, several_rates=args.all_speeds) for each in found)]))
    if any(each.profile == OTHERS for each in found):
        parts.append("generic: it does not tell its kind. `modbus-gateway profile list` shows the known ones.")
    if silent:
        parts.append(f"{silent} of {result.asked} {'unit' if result.asked == 1 else 'units'} did not answer.")
    if result.known:
        parts.append(f"In the config or in use, so not asked: {result.known}.")
    garbled = [str(each.unit) for each in found if each.result == "garbled"]
    if garbled:
        parts.append(f"Garbled ({', '.join(garbled)}): two devices may have this address, or rate or format are wrong.")
    if not found and not result.is_answered:
        others = "" if args.all_speeds else " --all-speeds tries other rates."
        parts.append(f"If no unit of this line answers: are wiring, rate, format and mode right?{others}")
    return "\n\n".join(parts)


def _cells(each: Found, *, several_rates: bool) -> tuple[str, ...]:
    result = f"exception {each.code:02X}" if each.code is not None and each.result == "exception" else each.result
    if each.answers_from is not None:
        result += f" as {each.answers_from}"
    paint = {"garbled": red, "exception": yellow}.get(each.result, str)
    answer = "-" if each.answer_ms is None else f"{each.answer_ms:.1f} ms"
    rate = (str(each.baud),) if several_rates else ()
    return (str(each.unit), paint(result), answer, _kind(each), *rate)


def _kind(each: Found) -> str:
    """Name the profile that fits, and the SunSpec models and where they are."""
    models = [f"{model.model} at {model.address}" for model in each.models]
    left_out = [f"{len(models) - _MOST_MODELS} more"] if len(models) > _MOST_MODELS else []
    shown = f"SunSpec: {', '.join([*models[:_MOST_MODELS], *left_out])}" if models else ""
    return "; ".join(part for part in (each.profile, shown) if part) or "-"
