"""`doctor`: what is wrong with a set-up, and what mends it."""

import argparse
import json
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from gateway.cli.daemon import Conversation, add_control_argument
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.config.load import load
from gateway.config.plan import Plan, resolve
from gateway.config.problem import Problem, did_you_mean
from gateway.diagnosis.finding import Finding, Level
from gateway.diagnosis.ports import about_ports
from gateway.errors import DaemonError
from gateway.ports.port import SerialSettings
from gateway.service.control import control_path
from gateway.service.doctor import PortInUse
from gateway.service.outside import look_at

#: How long the daemon may take, in seconds: it asks units, and may try other rates and formats on several lines.
_PATIENCE: Final = 120.0

_LEVELS: Final[Mapping[str, Level]] = {"error": "fix", "warning": "note"}

_EXAMPLES: Final = """\
examples:
  modbus-gateway doctor                  look at everything
  modbus-gateway doctor hall-a           look at one line
  modbus-gateway doctor --passive        send nothing on any line
  modbus-gateway doctor --config gateway.toml
                                         no gateway is running: what can be seen without one

Each row is ok, note or fix; behind a fix stands what mends it, and the exit
status is 1 then. Without --passive the running gateway may send reads of one
item: to configured units that were asked less than four times; when a unit is
silent, to at most 16 addresses that are not configured; when no unit of a
line answers, also at other rates and formats, for at most 30 s. It never
writes. A note tells what was sent.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `doctor`."""
    parser.epilog = _EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("line", nargs="?", metavar="LINE", help="the name of a line (default: all)")
    parser.add_argument("--passive", action="store_true", help="send nothing: use what the gateway has measured")
    parser.add_argument("--config", metavar="FILE", help=f"the config, when no gateway runs (default {DEFAULT_CONFIG})")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_control_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print the findings; 1 if something needs fixing.

    Raises:
        DaemonError: the daemon refuses the question, or there is no such line.
    """
    findings = _findings(args)
    if args.json:
        print(json.dumps({"findings": [asdict(finding) for finding in findings]}, indent=2, ensure_ascii=False))
    else:
        print(table(findings, shutil.get_terminal_size().columns))
    return PROBLEM_FOUND if any(finding.level == "fix" for finding in findings) else FINE


def table(findings: Iterable[Finding], width: int) -> str:
    """A row for each finding, and below it what mends it."""
    return "\n".join(line for finding in findings for line in _row(finding, width))


def _row(finding: Finding, width: int) -> list[str]:
    text = f"{finding.level:4}  {finding.about}: {finding.what}"
    lines = textwrap.wrap(text, max(width, 40), subsequent_indent=" " * 6, break_long_words=False)
    return [*lines, f"      -> {finding.remedy}"] if finding.remedy else lines


def _findings(args: argparse.Namespace) -> list[Finding]:
    try:
        daemon = None if args.config and not args.control else Conversation(args.control)
    except DaemonError as error:
        if args.control:
            raise
        return [_without_daemon(str(error)), *_look_at_config(Path(DEFAULT_CONFIG), args.line)]
    if daemon is None:
        return _look_at_config(Path(args.config), args.line)
    with daemon:
        if not args.passive and not args.json and sys.stderr.isatty():
            print("The gateway may ask units now, which can take a minute; --passive sends nothing.", file=sys.stderr)
        daemon.wait_for(_PATIENCE)
        answer = daemon.ask("doctor", line=args.line, ask=not args.passive)
        ports = [PortInUse(**port) for port in answer.get("ports", ())]
        measured = [_finding(row) for row in answer.get("findings", ())]
        return [*_about_ports(ports, daemon.pid), *measured]


def _about_ports(ports: Iterable[PortInUse], pid: int | None) -> list[Finding]:
    return [finding for port in ports for finding in about_ports(look_at(port, pid))]


def _finding(row: Mapping[str, Any]) -> Finding:
    """A finding of a daemon, perhaps of another version."""
    level = row.get("level")
    return Finding(
        level if level in ("ok", "note", "fix") else "note",
        str(row.get("about", "")),
        str(row.get("what", "")),
        str(row.get("remedy", "")),
    )


def _without_daemon(why: str) -> Finding:
    what = f"{why}; only what can be seen without one was looked at"
    return Finding("note", "gateway", what, "systemctl start modbus-gateway")


def _look_at_config(file: Path, line: str | None) -> list[Finding]:
    """What is wrong with the file, and with the ports that it names.

    Raises:
        DaemonError: the file has no such line.
    """
    loaded = load(file)
    findings = [
        Finding(_LEVELS[problem.severity], str(file), _told(problem), problem.remedy) for problem in loaded.problems
    ]
    if loaded.config is None:
        return findings
    if not findings:
        findings = [Finding("ok", str(file), "the config is valid")]
    plan = resolve(loaded.config)
    pid = _gateway_with(plan, file)
    if pid is not None:
        what = f"a gateway is running (process {pid}): without --config, doctor uses what it has measured"
        findings.append(Finding("note", "gateway", what))
    return [*findings, *_about_ports(_ports(plan, line), pid)]


def _told(problem: Problem) -> str:
    """The problem without the file, which the row names."""
    return str(replace(problem, remedy="")).removeprefix(problem.file).removeprefix(":").lstrip()


def _gateway_with(plan: Plan, file: Path) -> int | None:
    """The process of the gateway that runs with the socket of this config, if any."""
    try:
        with Conversation(plan.control or str(control_path(file))) as daemon:
            return daemon.pid
    except DaemonError:
        return None


def _ports(plan: Plan, line: str | None) -> list[PortInUse]:
    parts = [(one.line.name, one.line.source, one.port) for one in plan.lines]
    parts += [(one.line.name, one.line.source, one.port) for one in plan.servers]
    if line is not None and line not in {name for name, _, _ in parts}:
        remedy = did_you_mean(line, [name for name, _, _ in parts])
        raise DaemonError(f'there is no line "{line}"' + (f"; {remedy}" if remedy else ""))
    return [
        PortInUse(name, source, port.port, is_open=False)
        for name, source, port in parts
        if isinstance(port, SerialSettings) and line in (None, name)
    ]
