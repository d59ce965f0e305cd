"""What is wrong now: lines that are down or full, units that rest or fail, and what doctor says must be fixed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from gateway.diagnosis.finding import Finding
from gateway.operator.answers.status import AnyLine, LineStatus, Status, UpstreamStatus
from gateway.tools.examinations import Report
from gateway.web.pages.unit_states import ShownState

#: From this busy share on a line is said to be full.
FULL: Final = 0.85
#: How bad a trouble is, from the worst on. A panel has room for some only.
_BADNESS: Final = ("down", "resting", "fix", "full", "failing")
#: Results of requests that were not sent to their unit.
_UNSENT: Final = ("overdue", "resting", "queue_full", "expired", "line_down", "echo_suspected", "refused", "unwanted")


@dataclass(frozen=True, slots=True)
class Trouble:
    """What is wrong with the line, unit or broker of this name; a `reason` is in the gateway's words.

    `share` is the share of time in which a line was busy, or of unanswered `requests` of a unit in the last minutes; of
    these, `unsent` were not sent, most often for the result `unsent_for`. A resting unit is left alone for `rests_ms`
    more. `found` is what doctor says must be fixed.
    """

    kind: Literal["down", "resting", "failing", "full", "fix"]
    page: Literal["lines", "units", ""]
    name: str
    line: str = ""
    reason: str = ""
    share: float = 0.0
    requests: int = 0
    rests_ms: float = 0.0
    unsent: int = 0
    unsent_for: str = ""
    found: tuple[str, ...] = ()


def troubles(status: Status, states: Mapping[str, ShownState]) -> Iterator[Trouble]:
    """Yield what is wrong now, lines and the broker first."""
    known: tuple[AnyLine, ...] = (*status.lines, *status.servers, *status.upstreams)
    for each in known:
        if each.state == "down":
            yield Trouble("down", "lines", each.name, reason=each.reason)
    for broker in status.brokers:
        if broker.state == "down":
            yield Trouble("down", "", f"broker {broker.broker}", reason=broker.reason)
    busy: tuple[LineStatus | UpstreamStatus, ...] = (*status.lines, *status.upstreams)
    for line in busy:
        share = line.busy_share or 0.0
        if share >= FULL:
            yield Trouble("full", "lines", line.name, share=share)
    down = {each.name for each in known if each.state in ("down", "standby")}
    for kind in ("resting", "failing"):
        for unit in status.units:
            state = states[unit.name]
            if state.word == kind and unit.line not in down:
                yield _of_unit(unit, kind, state)


def _of_unit(unit: Any, kind: Literal["resting", "failing"], state: ShownState) -> Trouble:
    return Trouble(
        kind,
        "units",
        unit.name,
        unit.line,
        unit.last_error,
        state.use.unanswered_share,
        state.use.requests,
        unit.rests_ms,
        state.use.unsent,
        max(_UNSENT, key=lambda result: getattr(unit.counts, result)) if state.use.unsent else "",
    )


def with_findings(known: Sequence[Trouble], report: Report) -> list[Trouble]:
    """Add what doctor says must be fixed to the troubles, and append what is wrong besides."""
    fixes: dict[tuple[str, str], Trouble] = {}
    for line, findings in report.groups:
        for each in findings:
            if each.level == "fix":
                one = _trouble(each, line)
                before = fixes.setdefault((one.page, one.name), one)
                fixes[one.page, one.name] = replace(one, found=(*before.found, each.what))
    told = []
    for trouble in known:
        fix = fixes.pop((trouble.page, trouble.name), None)
        # If it is down, its row says already what doctor would add.
        told.append(trouble if fix is None or trouble.kind == "down" else replace(trouble, found=fix.found))
    return [*told, *fixes.values()]


def worst_first(known: Sequence[Trouble]) -> list[Trouble]:
    """Sort troubles, the worst first; a failing unit with a finding counts as one that must be fixed."""
    return sorted(known, key=lambda each: _BADNESS.index("fix" if each.found and each.kind == "failing" else each.kind))


def _trouble(finding: Finding, line: str) -> Trouble:
    if finding.unit:
        return Trouble("fix", "units", finding.unit, line)
    return Trouble("fix", "lines", line) if line else Trouble("fix", "", finding.about)
