"""The page of a line or upstream: its last transactions, its units, and its history of the last day."""

import asyncio
from collections.abc import Sequence
from typing import Final

from aiohttp import web

from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.trace import Fact
from gateway.operator.operations.asked import Traced
from gateway.operator.past.past import past_of
from gateway.operator.status.status import recent_status
from gateway.operator.status.unit_states import lines_down, states_of
from gateway.operator.trace.meanings import points_of
from gateway.operator.trace.reader import latest
from gateway.operator.units.units import units_of
from gateway.timing.history import UNIT_SLOTS
from gateway.web.access.guard import VISITOR
from gateway.web.front.problems import ProblemError
from gateway.web.pages.busy import busy_outline, hours
from gateway.web.pages.function_names import function_name
from gateway.web.pages.heat_map import ShownUnits, axis
from gateway.web.pages.line_past import SPANS, drawn, past_for
from gateway.web.pages.page import Page, route
from gateway.web.pages.shown_lines import shown_lines
from gateway.web.pages.transactions import asked, outcome, row

#: The table without JavaScript: this many transactions at most, found among this many records of the line.
MOST_FACTS: Final = 20
_LOOKED_AT: Final = 5 * MOST_FACTS


class LinePage(Page):
    """The handler of `/lines/NAME`."""

    @route("GET", "/lines/{name}")
    async def show(self, request: web.Request) -> web.Response:
        """Show one line or upstream.

        Raises:
            ProblemError: 404, there is none of this name.
        """
        name = request.match_info["name"]
        status = await recent_status(self._operator)
        line = next((each for each in shown_lines(status) if each.name == name), None)
        if line is None:
            raise ProblemError(404, f"there is no line {name}")
        try:
            facts, why = await self._last_facts(name, request[VISITOR].host), ""
        except WrongQuestion as wrong:
            facts, why = (), str(wrong)
        points = points_of(self._operator)
        past, now = past_of(self._operator, UNIT_SLOTS), asyncio.get_running_loop().time()
        with_page = frozenset(unit.name for unit in units_of(self._operator))
        units = tuple(unit for unit in status.units if unit.line == name)
        span, has_past = request.query.get("span", ""), not line.is_asked
        wanted = await past_for(self._operator, name, span) if has_past and span in SPANS else None
        return await self._renderer.page(
            "line.html",
            request,
            line=line,
            status=line.status,
            asked=asked,
            outcome=outcome,
            function_name=function_name,
            why=why,
            with_page=with_page,
            numbers={unit.name: unit.unit for unit in units if unit.unit is not None},
            spans=SPANS if has_past else (),
            span=span if wanted else "",
            # The template calls these in the thread that makes the page.
            rows=lambda: [row(fact, points) for fact in facts],
            busy_outline=lambda: busy_outline(past, name),
            line_past=lambda: wanted and drawn(span, *wanted, name, [unit.name for unit in units]),
            hours=lambda: hours(past, name),
            shown_units=lambda: ShownUnits(
                units,
                self._heat_map.rows(status.units, past, now),
                states_of(units, past, lines_down(status)),
                axis(past),
                with_page,
            ),
        )

    async def _last_facts(self, line: str, host: str) -> Sequence[Fact]:
        """List the last transactions on a line that a reader at this address may see, newest first."""
        facts = await latest(self._operator.running, Traced(line=line), host, _LOOKED_AT)
        shown = [fact for fact in facts if fact["kind"] in ("exchange", "answered", "refused")]
        return shown[:MOST_FACTS]
