"""The first page: what is wrong, what the lines do, and how each unit has answered in the last day."""

import asyncio
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal

from aiohttp import web

from gateway.diagnosis.finding import Finding
from gateway.operator.answers.status import AnyLine, LineStatus, Status, UnitStatus, UpstreamStatus
from gateway.operator.operator import Operator
from gateway.operator.past import past_of
from gateway.operator.status import recent_status
from gateway.operator.units import units_of
from gateway.timing.history import UNIT_SLOTS, Past
from gateway.tools.examinations import Examinations, Report
from gateway.web.access.guard import Need
from gateway.web.front.problems import Handler
from gateway.web.pages.busy import busy_outline
from gateway.web.pages.health import counted
from gateway.web.pages.heat_map import HeatMap, HeatRow, ShownUnits, axis
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.shown_lines import ShownLine, shown_lines
from gateway.web.pages.unit_states import ShownState, states_of

#: From this busy share on a line is said to be full.
FULL: Final = 0.85
#: With more units than this, those not asked in the last day are not listed: a line may pass all through.
ALL_SHOWN: Final = 32
#: A wall panel shows no more lines and units than these, those with problems first: it cannot be scrolled.
PANEL_LINES: Final = 10
PANEL_UNITS: Final = 12
_WRONG_FIRST: Final = {"resting": 0, "failing": 1}
#: How bad a trouble is, from the worst on. A panel has room for some only.
_BADNESS: Final = ("down", "resting", "fix", "full", "failing")
#: Results of requests that were not sent to their unit.
_UNSENT: Final = ("overdue", "resting", "queue_full", "expired", "line_down", "echo_suspected", "refused", "unwanted")
_SOME_LOST: Final = 2
_FINE: Final = 3


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


class OverviewPage:
    """The handler of `/`."""

    def __init__(self, operator: Operator, doctor: Examinations, renderer: Renderer, heat_map: HeatMap) -> None:
        self._operator = operator
        self._doctor = doctor
        self._renderer = renderer
        self._heat_map = heat_map

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List the routes: method, path, handler, and what it needs."""
        return [("GET", "/", self.show, "page")]

    async def show(self, request: web.Request) -> web.Response:
        """Show the state of everything."""
        status, past = await recent_status(self._operator), past_of(self._operator, UNIT_SLOTS)
        with_page = frozenset(unit.name for unit in units_of(self._operator))
        now, report = asyncio.get_running_loop().time(), await self._doctor.measured()
        is_panel = "kiosk" in request.query

        def content() -> Mapping[str, Any]:
            states, lines = states_of(status.units, past), tuple(shown_lines(status))
            found = with_findings(list(troubles(status, states)), report)
            return {
                "lines": _of_panel(lines) if is_panel else lines,
                "troubles": worst_first(found) if is_panel else found,
                "counted": counted(report),
                "axis": axis(past),
                "shown_units": lambda: shown_units(
                    status,
                    self._heat_map.rows(status.units, past, now),
                    states,
                    past,
                    with_page,
                    PANEL_UNITS if is_panel else None,
                ),
            }

        return await self._renderer.page(
            "kiosk.html" if is_panel else "overview.html",
            request,
            content,
            status=status,
            with_page=with_page,
            busy_outline=partial(busy_outline, past),
        )


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


def _of_panel(lines: Sequence[ShownLine]) -> Sequence[ShownLine]:
    """Choose the lines that a panel has room for, in the order of the config."""
    if len(lines) <= PANEL_LINES:
        return lines
    first = sorted(lines, key=lambda line: (line.status.state != "down", -(line.busy_share or 0.0)))[:PANEL_LINES]
    return [line for line in lines if line in first]


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


def shown_units(
    status: Status,
    rows: Mapping[str, HeatRow],
    states: Mapping[str, ShownState],
    past: Past,
    with_page: frozenset[str],
    most: int | None = None,
) -> ShownUnits:
    """Choose and sort the units of the heat map, at most `most`."""
    units: Sequence[UnitStatus] = status.units
    if len(units) > ALL_SHOWN:
        units = [unit for unit in units if rows[unit.name].use.requests or states[unit.name].word != "not asked"]
    ordered = sorted(units, key=lambda unit: _rank(states[unit.name], rows[unit.name]))[:most]
    left_out = len(status.units) - len(ordered)
    return ShownUnits(tuple(ordered), rows, states, axis(past), with_page, left_out=left_out)


def _rank(state: ShownState, row: HeatRow) -> int:
    return _WRONG_FIRST.get(state.word, _SOME_LOST if row.use.unanswered else _FINE)
