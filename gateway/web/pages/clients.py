"""The page of the clients: who is connected, who was rejected, and what rights each of them has."""

import re
from collections.abc import Sequence
from typing import Final

from aiohttp import web

from gateway.config.plan.rights_in_words import rows_in_words
from gateway.errors import WrongQuestion
from gateway.operator.operations.asked import Traced
from gateway.operator.status.status import recent_status
from gateway.operator.trace.reader import latest
from gateway.operator.units.rights import Client, Verdict, routers, verdict
from gateway.operator.units.units import units_of
from gateway.plant.status import show_use
from gateway.tls.status import EARLY
from gateway.trace.pdus import FUNCTIONS
from gateway.web.access.guard import VISITOR
from gateway.web.pages.page import Page, route

#: This many clients are shown, those first that asked last, and this many requests without a right.
MOST_CLIENTS: Final = 200
MOST_DENIED: Final = 10
_NUMBER: Final = re.compile(r"[0-9]{1,5}")
#: The fields of the form.
_FIELDS: Final = ("from", "listener", "role", "unit", "function", "address")


class ClientsPage(Page):
    """The handler of `/clients`."""

    @route("GET", "/clients")
    async def show(self, request: web.Request) -> web.Response:
        """Show clients and rights; the address has the fields of the form."""
        asked = {name: request.query.get(name, "").strip() for name in _FIELDS}
        found, why = self._verdict(asked)
        status = await recent_status(self._operator)
        never = float("inf")
        clients = sorted(status.clients, key=lambda each: never if each.asked_ms is None else each.asked_ms)
        return await self._renderer.page(
            "clients.html",
            request,
            status=status,
            use=show_use,
            clients=clients[:MOST_CLIENTS],
            more=max(0, len(clients) - MOST_CLIENTS),
            denied=await self._denied(request[VISITOR].host),
            certificates=sorted(status.certificates, key=lambda each: each.days_left),
            soon=EARLY,
            rights=rows_in_words(self._operator.gateway.plan),
            entrances=tuple(routers(self._operator.running)),
            units=[(each.unit, each.name) for each in units_of(self._operator) if each.unit is not None],
            functions=FUNCTIONS,
            asked=asked,
            verdict=found,
            why=why,
        )

    def _verdict(self, asked: dict[str, str]) -> tuple[Verdict | None, str]:
        """Decide what the form asks, or say why that is not possible; neither without a question."""
        if not asked["from"]:
            return None, ""
        unit, function, address = asked["unit"], asked["function"], asked["address"]
        if not (_NUMBER.fullmatch(unit) and 1 <= int(unit) <= 255):
            return None, f'"{unit}" is no unit: 1 to 255'
        if not (_NUMBER.fullmatch(function) and 1 <= int(function) <= 127):
            return None, f'"{function}" is no function: 1 to 127'
        if address and not (_NUMBER.fullmatch(address) and int(address) <= 65535):
            return None, f'"{address}" is no address: 0 to 65535'
        client = Client(asked["from"], asked["listener"], asked["role"])
        at = int(address) if address else None
        try:
            return verdict(self._operator.running, client, int(unit), int(function), at), ""
        except WrongQuestion as wrong:
            return None, str(wrong)

    async def _denied(self, host: str) -> Sequence[object]:
        """List the last requests that a client had no right to."""
        try:
            return await latest(self._operator.running, Traced(result="denied"), host, MOST_DENIED)
        except WrongQuestion:  # nothing is kept
            return ()
