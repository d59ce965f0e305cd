"""The first page: lines, units, images, listeners and clients."""

from collections.abc import Sequence

from aiohttp import web

from gateway.web.answers import Answers
from gateway.web.guard import Need
from gateway.web.pages.shown_lines import shown_lines
from gateway.web.problems import Handler
from gateway.web.renderer import Renderer


class OverviewPage:
    """The handler of `/`."""

    def __init__(self, answers: Answers, renderer: Renderer) -> None:
        self._answers = answers
        self._renderer = renderer

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """Method, path, handler, and what it needs."""
        return [("GET", "/", self.show, "page")]

    async def show(self, request: web.Request) -> web.Response:
        """How everything is."""
        status = await self._answers.status()
        return await self._renderer.page("overview.html", request, status=status, lines=tuple(shown_lines(status)))
