"""The first page: what is wrong, what the lines do, and how each unit has answered in the last day."""

import asyncio
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

from aiohttp import web

from gateway.operator.operations.answers.status import Status, UpstreamStatus
from gateway.operator.operations.answers.trouble import worst_first
from gateway.operator.status.unit_states import ShownState
from gateway.operator.units.units import units_of
from gateway.timing.history import Past
from gateway.web.pages.busy import busy_outline
from gateway.web.pages.health import counted
from gateway.web.pages.heat_map import HeatRow, ShownUnits, axis
from gateway.web.pages.page import Page, route
from gateway.web.pages.shown_lines import ShownLine, is_site, shown_lines
from gateway.web.pages.tiles import tiles_of

#: With more units than this, those not asked in the last day are not listed: a line may pass all through.
ALL_SHOWN: Final = 32
#: A wall panel shows no more lines and units than these, those with problems first: it cannot be scrolled.
PANEL_LINES: Final = 10
PANEL_UNITS: Final = 12
_WRONG_FIRST: Final = {"line down": 0, "resting": 0, "failing": 1}
#: Units of other sites that are listed: where the site is down, its own row says so.
_OF_SITES: Final = ("resting", "failing")
_SOME_LOST: Final = 2
_FINE: Final = 3


class OverviewPage(Page):
    """The handler of `/`."""

    @route("GET", "/")
    async def show(self, request: web.Request) -> web.Response:
        """Show the state of everything."""
        seen = await self._situations.now()
        status, past = seen.status, seen.past
        with_page = frozenset(unit.name for unit in units_of(self._operator))
        now, is_panel = asyncio.get_running_loop().time(), "kiosk" in request.query

        def content() -> Mapping[str, Any]:
            sites = {each.name: each for each in status.upstreams if is_site(each) and not is_panel}
            lines = tuple(each for each in shown_lines(status) if each.name not in sites)
            return {
                "lines": _of_panel(lines) if is_panel else lines,
                "sites": list(_rows(sites, status, seen.states)),
                "upstreams": [each for each in status.upstreams if each.name not in sites],
                "troubles": worst_first(seen.troubles) if is_panel else seen.troubles,
                "tiles": tiles_of(status, seen.states, with_page),
                "counted": counted(seen.report),
                "axis": axis(past),
                "shown_units": lambda: shown_units(
                    status,
                    self._heat_map.rows(status.units, past, now),
                    seen.states,
                    past,
                    with_page,
                    sites,
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


def _of_panel(lines: Sequence[ShownLine]) -> Sequence[ShownLine]:
    """Choose the lines that a panel has room for, in the order of the config."""
    if len(lines) <= PANEL_LINES:
        return lines
    first = sorted(lines, key=lambda line: (line.status.state != "down", -(line.busy_share or 0.0)))[:PANEL_LINES]
    return [line for line in lines if line in first]


def _rows(
    sites: Mapping[str, UpstreamStatus], status: Status, states: Mapping[str, ShownState]
) -> Iterator[tuple[UpstreamStatus, int, int]]:
    """List sites, each with how many of its units answer, and how many were asked."""
    words = {name: Counter[str]() for name in sites}
    for unit in status.units:
        if unit.line in words:
            words[unit.line][states[unit.name].word] += 1
    for name, site in sites.items():
        yield site, words[name]["fine"], words[name].total() - words[name]["not asked"]


def shown_units(
    status: Status,
    rows: Mapping[str, HeatRow],
    states: Mapping[str, ShownState],
    past: Past,
    with_page: frozenset[str],
    sites: Container[str],
    most: int | None = None,
) -> ShownUnits:
    """Choose and sort the units of the heat map, at most `most`; of other sites those that do not answer."""
    units = [unit for unit in status.units if unit.line not in sites or states[unit.name].word in _OF_SITES]
    count = len(units)
    if count > ALL_SHOWN:
        units = [unit for unit in units if rows[unit.name].use.requests or states[unit.name].word != "not asked"]
    ordered = sorted(units, key=lambda unit: _rank(states[unit.name], rows[unit.name]))[:most]
    left_out = count - len(ordered)
    return ShownUnits(tuple(ordered), rows, states, axis(past), with_page, left_out=left_out)


def _rank(state: ShownState, row: HeatRow) -> int:
    return _WRONG_FIRST.get(state.word, _SOME_LOST if row.use.unanswered else _FINE)
