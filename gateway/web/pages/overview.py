"""The first page: what is wrong, what the lines do, and how each unit has answered in the last day."""

import asyncio
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Literal

from aiohttp import web

from gateway.timing.history import UNIT_SLOTS, Past
from gateway.web.answers import Answers, Status
from gateway.web.guard import Need
from gateway.web.pages.busy import busy_outline
from gateway.web.pages.heat_map import HeatMap, HeatRow, ShownUnits, axis
from gateway.web.pages.shown_lines import ShownLine, shown_lines
from gateway.web.problems import Handler
from gateway.web.renderer import Renderer

#: From this busy share on a line is said to be full.
FULL: Final = 0.85
#: With more units than this, those that nobody has asked in the last day are not listed: a line may pass all through.
ALL_SHOWN: Final = 32
#: A wall panel shows no more lines and units than these, those with problems first: it cannot be scrolled.
PANEL_LINES: Final = 10
PANEL_UNITS: Final = 12
_WRONG_FIRST: Final = {"resting": 0, "failing": 1}
_SOME_LOST: Final = 2
_FINE: Final = 3


@dataclass(frozen=True, slots=True)
class Trouble:
    """What is wrong with the line or unit of this name; a `reason` is in the gateway's words."""

    kind: Literal["down", "resting", "failing", "full"]
    page: Literal["lines", "units"]
    name: str
    line: str = ""
    reason: str = ""
    share: float = 0.0


class OverviewPage:
    """The handler of `/`."""

    def __init__(self, answers: Answers, renderer: Renderer, heat_map: HeatMap) -> None:
        self._answers = answers
        self._renderer = renderer
        self._heat_map = heat_map

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """Method, path, handler, and what it needs."""
        return [("GET", "/", self.show, "page")]

    async def show(self, request: web.Request) -> web.Response:
        """How everything is."""
        status, past = await self._answers.status(), self._answers.past(UNIT_SLOTS)
        with_page = frozenset(unit.name for unit in self._answers.units())
        now = asyncio.get_running_loop().time()
        is_panel = "kiosk" in request.query
        lines = tuple(shown_lines(status))
        return await self._renderer.page(
            "kiosk.html" if is_panel else "overview.html",
            request,
            status=status,
            lines=_of_panel(lines) if is_panel else lines,
            troubles=tuple(troubles(status)),
            axis=axis(past),
            with_page=with_page,
            # The template calls these in the thread that makes the page.
            shown_units=lambda: shown_units(
                status,
                self._heat_map.rows(status.units, past, now),
                past,
                with_page,
                PANEL_UNITS if is_panel else None,
            ),
            busy_outline=partial(busy_outline, past),
        )


def troubles(status: Status) -> Iterator[Trouble]:
    """What is wrong now, lines first."""
    for line in (*status.lines, *status.servers, *status.upstreams):
        if line.state == "down":
            yield Trouble("down", "lines", line.name, reason=line.reason)
    for line in status.lines:
        if (line.busy_share or 0.0) >= FULL:
            yield Trouble("full", "lines", line.name, share=line.busy_share)
    down = {line.name for line in (*status.lines, *status.upstreams) if line.state == "down"}
    for kind in ("resting", "failing"):
        for unit in status.units:
            if unit.state == kind and unit.line not in down:
                yield Trouble(kind, "units", unit.name, unit.line, unit.last_error)


def shown_units(
    status: Status, rows: Mapping[str, HeatRow], past: Past, with_page: frozenset[str], most: int | None = None
) -> ShownUnits:
    """The units of the heat map, at most so many."""
    units = status.units
    if len(units) > ALL_SHOWN:
        units = [unit for unit in units if rows[unit.name].use.requests or unit.state != "fine"]
    ordered = sorted(units, key=lambda unit: _rank(unit, rows[unit.name]))[:most]
    return ShownUnits(tuple(ordered), rows, axis(past), with_page, left_out=len(status.units) - len(ordered))


def _of_panel(lines: Sequence[ShownLine]) -> Sequence[ShownLine]:
    """Those that there is room for, in the order of the config."""
    if len(lines) <= PANEL_LINES:
        return lines
    first = sorted(lines, key=lambda line: (line.status.state != "down", -(line.busy_share or 0.0)))[:PANEL_LINES]
    return [line for line in lines if line in first]


def _rank(unit: Any, row: HeatRow) -> int:
    return _WRONG_FIRST.get(unit.state, _SOME_LOST if row.use.unanswered else _FINE)
