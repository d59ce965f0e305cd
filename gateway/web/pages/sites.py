"""The page of the sites of the fleet, with what each of them is and has."""

import asyncio
from collections.abc import Sequence
from typing import Final

from aiohttp import web

from gateway.errors import FleetError
from gateway.fleet.status import SiteStatus
from gateway.operator.fleet.sites import days_left, is_fine, summary_of, to_fix, today
from gateway.operator.fleet.sites_csv import sites_as_csv
from gateway.tls.status import EARLY
from gateway.web.pages.page import Page, csv_file, route

#: How long NATS may take to list the sites, and how old the list may be, in seconds: a site renews its entry as often.
_PATIENCE: Final = 5.0
KEPT: Final = 10.0


class SitesPage(Page):
    """The handlers of `/sites` and `/sites.csv`."""

    @route("GET", "/sites")
    async def show(self, request: web.Request) -> web.Response:
        """Show all sites, those first that are not fine; above them all that is known of the `site` in the address."""
        sites, why = await self._sites()
        day, name = today(self._operator.clock()), request.query.get("site", "")
        return await self._renderer.page(
            "sites.html",
            request,
            lambda: {"sites": sorted(sites, key=lambda each: is_fine(each, day)), "summary": summary_of(sites, day)},
            why=why,
            chosen=next((each for each in sites if each.site == name), None),
            to_fix=to_fix,
            days_left=lambda each: days_left(each, day),
            soon=EARLY,
        )

    @route("GET", "/sites.csv")
    async def download(self, request: web.Request) -> web.Response:  # noqa: ARG002 - a handler
        """Send all sites as CSV.

        Raises:
            HTTPServiceUnavailable: they are not known.
        """
        sites, why = await self._sites()
        if why:
            raise web.HTTPServiceUnavailable(text=f"{why}\n")
        return await csv_file("sites", lambda: sites_as_csv(sites))

    async def _sites(self) -> tuple[Sequence[SiteStatus], str]:
        """List the sites, or say why they are not known."""
        try:
            async with asyncio.timeout(_PATIENCE):
                return await self._operator.running.add_ons.fleet.sites(KEPT), ""
        except FleetError as error:
            return (), str(error)
        except TimeoutError:
            return (), "NATS takes too long"
