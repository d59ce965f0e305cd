"""The page of a config that was in use before."""

import asyncio
from collections.abc import Sequence

from aiohttp import web

from gateway.clock.threads import ThreadPerCall
from gateway.operator.config.applied import AppliedRow, AppliedViewer
from gateway.operator.operator import Operator
from gateway.web.access.guard import VISITOR, Need
from gateway.web.front.problems import Handler, ProblemError
from gateway.web.front.turns import Turns
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.times import day_and_time


class AppliedPage:
    """The handler of `/config/applied/NAME`, and the rows that lead there."""

    def __init__(self, operator: Operator, renderer: Renderer) -> None:
        self._viewer = AppliedViewer(operator.reloader)
        self._renderer = renderer
        self._turns = Turns()

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List the routes: method, path, handler, and what it needs."""
        return [("GET", "/config/applied/{name}", self.show, "page")]

    async def show(self, request: web.Request) -> web.Response:
        """Show a config that was in use.

        Raises:
            ProblemError: 403, whoever asks is no operator; 404, it is not kept any more.
        """
        if request[VISITOR].role != "operator":
            raise ProblemError(403, "configs that were in use before are shown to operators")
        async with self._turns.turn(request):
            loop, name = asyncio.get_running_loop(), request.match_info["name"]
            view = await loop.run_in_executor(ThreadPerCall("web config"), self._viewer.view, name)
        if view is None:
            raise ProblemError(404, "this config is not kept any more: the last ten are")
        return await self._renderer.page("applied.html", request, view=view, at=day_and_time(view.at.timestamp()))

    async def rows(self, request: web.Request) -> Sequence[tuple[AppliedRow, str]]:
        """List what is kept, each with its time in words."""
        async with self._turns.turn(request):
            found = await asyncio.get_running_loop().run_in_executor(ThreadPerCall("web config"), self._viewer.rows)
        return [(each, day_and_time(each.at.timestamp())) for each in found]
