"""`doctor`: what is wrong with a set-up, and the remedy."""

import argparse
import json
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.daemon import CONTROL_VARIABLE, Conversation, add_control_argument, which_gateway
from gateway.cli.kit.paint import red, yellow
from gateway.cli.kit.progress import working
from gateway.cli.kit.usage import baud, parsed_by
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.config.problem import WrongValue
from gateway.config.values.port import parse_format
from gateway.diagnosis.finding import Finding
from gateway.diagnosis.ports import with_ports
from gateway.errors import DaemonError
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT
from gateway.operator.operations.asked import ToExamine
from gateway.operator.operations.table import DOCTOR
from gateway.timing.characters import CharacterFormat
from gateway.tools.outside import findings_about

_PAINTS: Final[Mapping[str, Callable[[str], str]]] = {"fix": red, "note": yellow}
#: How long the gateway may take, in seconds: it asks units, and may try other rates and formats on several lines.
_PATIENCE: Final = 120.0

_ABOUT: Final = """\
Each row is ok, note or fix; below a fix is the remedy, and the exit
status is 1 then. Without --passive the running gateway may send reads of one
item: to configured units that were asked fewer than four times, and to units
whose last request failed, or that have not answered for a minute or since
another one has failed; when a unit is silent, to at most 16 addresses that
are not configured; when no unit of a line answers, also at other rates and
formats, for at most 30 s. It never writes. A note tells what was sent.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `doctor`."""
    parser.epilog = _ABOUT
    parser.add_argument("line", nargs="?", metavar="LINE", help="the name of a line (default: all)")
    parser.add_argument("--passive", action="store_true", help="send nothing: use what the gateway has measured")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_control_argument(parser)
    add_report_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print the findings; 1 if something needs fixing."""
    if args.hardware_report:
        from gateway.cli.doctor.hardware_report import make_report  # noqa: PLC0415 - opens a port in an event loop

        return make_report(args)
    findings = _findings(args)
    if args.json:
        print(json.dumps({"findings": [asdict(finding) for finding in findings]}, indent=2, ensure_ascii=False))
    else:
        print(table(findings, shutil.get_terminal_size().columns))
    return PROBLEM_FOUND if any(finding.level == "fix" for finding in findings) else FINE


def table(findings: Iterable[Finding], width: int) -> str:
    """Show a row for each finding, and below it the remedy."""
    return "\n".join(line for finding in findings for line in _row(finding, width))


def _row(finding: Finding, width: int) -> list[str]:
    text = f"{finding.level:4}  {finding.about}: {finding.what}"
    lines = textwrap.wrap(text, max(width, 40), subsequent_indent=" " * 6, break_long_words=False)
    paint = _PAINTS.get(finding.level, str)
    lines[0] = paint(finding.level) + lines[0].removeprefix(finding.level)
    return [*lines, f"      -> {finding.remedy}"] if finding.remedy else lines


def _findings(args: argparse.Namespace) -> list[Finding]:
    try:
        daemon = Conversation(which_gateway(args))
    except DaemonError as error:
        if args.control or (os.environ.get(CONTROL_VARIABLE) and not args.config):
            raise
        return [_without_daemon(str(error), args.config), *_in_config(args)]
    with daemon:
        if not args.passive and not args.json and sys.stderr.isatty():
            print("The gateway may ask units now, which can take a minute; --passive sends nothing.", file=sys.stderr)
        daemon.wait_for(_PATIENCE)
        with working("examining"):
            examination = daemon.ask(DOCTOR, ToExamine(args.line, not args.passive))
        return with_ports(findings_about(examination.ports, daemon.pid), examination.findings)


def _in_config(args: argparse.Namespace) -> list[Finding]:
    """Look at the config whose gateway does not answer: the one that is named, or that of the service, if any."""
    if not args.config and not Path(DEFAULT_CONFIG).exists():
        return []
    from gateway.cli.doctor.config import look_at_config  # noqa: PLC0415 - only here a config is read

    return look_at_config(Path(args.config or DEFAULT_CONFIG), args.line)


def _without_daemon(why: str, config: str | None) -> Finding:
    what = f"{why}; only what can be seen without one was looked at"
    if config:
        return Finding("note", "gateway", what, f"modbus-gateway run {config}")
    if Path(DEFAULT_CONFIG).exists():
        return Finding("note", "gateway", what, "systemctl start modbus-gateway")
    remedy = "start it: modbus-gateway run FILE; or look at its config: modbus-gateway doctor --config FILE"
    return Finding("fix", "gateway", why, remedy)


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
