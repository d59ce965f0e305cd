"""What `doctor` finds without a gateway: in the config file, and of the ports that it names."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.config.load import load
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, did_you_mean
from gateway.config.reading.source import place_of
from gateway.diagnosis.evidence import PortInUse
from gateway.diagnosis.finding import Finding, Level
from gateway.errors import DaemonError
from gateway.ports.port import SerialSettings
from gateway.tools.outside import findings_about

_LEVELS: Final[Mapping[str, Level]] = {"error": "fix", "warning": "note"}


def look_at_config(file: Path, line: str | None) -> list[Finding]:
    """Find what is wrong with the file, and with the ports that it names; of one line, if one is named.

    Raises:
        DaemonError: the file has no such line.
    """
    loaded = load(file)
    findings = [
        Finding(_LEVELS[problem.severity], problem.file, _told(problem), problem.remedy) for problem in loaded.problems
    ]
    if loaded.plan is None:
        return findings
    if not findings:
        findings = [Finding("ok", str(file), "the config is valid")]
    return [*findings, *findings_about(_ports(loaded.plan, line), None)]


def _told(problem: Problem) -> str:
    """Show the problem without the file, which the row names."""
    return str(replace(problem, remedy="")).removeprefix(problem.file).removeprefix(":").lstrip()


def _ports(plan: Plan, line: str | None) -> list[PortInUse]:
    parts = [(one.line.name, one.line.source, one.port) for one in plan.lines]
    parts += [(one.line.name, one.line.source, one.port) for one in plan.servers]
    parts += [(one.line.name, one.line.source, one.port) for one in plan.monitors]
    if line is not None and line not in {name for name, _, _ in parts}:
        remedy = did_you_mean(line, [name for name, _, _ in parts])
        raise DaemonError(f'there is no line "{line}"' + (f"; {remedy}" if remedy else ""))
    return [
        PortInUse(name, place_of(source, "port"), port.port, is_open=False)
        for name, source, port in parts
        if isinstance(port, SerialSettings) and line in (None, name)
    ]
