"""The page of the traffic: the last transactions on all lines, as selected by the address."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Final
from urllib.parse import urlencode

from aiohttp import web

from gateway.errors import WrongQuestion
from gateway.listeners.hosts import split_host
from gateway.operator.operations.answers.trace import Fact
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.parameters import read_parameters
from gateway.operator.status.status import recent_status
from gateway.operator.trace.meanings import Points, points_of
from gateway.operator.trace.reader import latest
from gateway.operator.units.units import units_of
from gateway.trace.pdus import FUNCTIONS
from gateway.trace.records import RESULTS
from gateway.web.access.guard import VISITOR
from gateway.web.api.trace import RecordsToFollow
from gateway.web.pages.page import Page, route
from gateway.web.pages.shown_lines import shown_lines
from gateway.web.pages.transactions import asked, outcome, row

#: This many transactions are on the page as the server makes it; a script adds more as they come.
MOST_ROWS: Final = 50
#: What selects among them, and how long a capture file reaches back, in seconds.
CHOICES: Final = ("line", "unit", "function", "client", "result")
_CAPTURED: Final = "300"


class TrafficPage(Page):
    """The handler of `/traffic`."""

    @route("GET", "/traffic")
    async def show(self, request: web.Request) -> web.Response:
        """Show the last transactions that the address selects."""
        chosen = {name: text for name in CHOICES if (text := request.query.get(name, "").strip())}
        try:
            wanted = read_parameters(RecordsToFollow, chosen, is_text=True).traced
            facts, why = await latest(self._operator.running, wanted, request[VISITOR].host, MOST_ROWS), ""
        except WrongQuestion as wrong:
            facts, why = (), str(wrong)
        status = await recent_status(self._operator)
        lines = {each.name: each for each in shown_lines(status)}
        return await self._renderer.page(
            "traffic.html",
            request,
            rows=partial(_rows, facts, points_of(self._operator)),
            is_any=bool(facts),
            why=why,
            chosen=dict.fromkeys(CHOICES, "") | chosen,
            lines=lines,
            modes={name: (each.mode, each.baud, each.format) for name, each in lines.items()},
            units=[choice(each) for each in units_of(self._operator)],
            functions=FUNCTIONS,
            clients=sorted({split_host(each.client) for each in status.clients}),
            results=RESULTS,
            query=urlencode(chosen),
            capture=urlencode({**chosen, "seconds": _CAPTURED}),
            asked=asked,
            outcome=outcome,
        )


def _rows(facts: Sequence[Fact], points: Points) -> Iterator[dict[str, Any]]:
    """Make the rows, in the thread that makes the page."""
    return (row(fact, points) for fact in facts)


def choice(unit: UnitPicture) -> tuple[int | str, str]:
    """Make the choice of a unit: what selects it, and its text."""
    return (unit.name, unit.name) if unit.unit is None else (unit.unit, f"{unit.unit} {unit.name}")
