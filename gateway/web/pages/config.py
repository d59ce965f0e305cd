"""The page of the config: shown and checked here, edited in its file."""

from collections.abc import Sequence
from shlex import quote

from aiohttp import web

from gateway.operator.config.reload import reload
from gateway.operator.config.view import ConfigView, ConfigViewer
from gateway.operator.operations.operation import Nothing
from gateway.operator.operator import Operator
from gateway.web.access.guard import Need
from gateway.web.api.asking import asker_of
from gateway.web.front.problems import Handler
from gateway.web.front.turns import Turns
from gateway.web.pages.applied import AppliedPage
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.times import day_and_time


class ConfigPage:
    """The handlers of `/config`."""

    def __init__(self, operator: Operator, renderer: Renderer, applied: AppliedPage) -> None:
        self._operator = operator
        self._viewer = ConfigViewer(operator.running, operator.reloader, operator.clock)
        self._renderer = renderer
        self._applied = applied
        self._turns = Turns()

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List the routes: method, path, handler, and what it needs."""
        return [("GET", "/config", self.show, "page"), ("POST", "/config/reload", self.reload, "operator")]

    async def show(self, request: web.Request) -> web.Response:
        """Show what is in use, what the file says now, and the outcome of the last reload."""
        async with self._turns.turn(request):
            config = await self._viewer.view()
        return await self._renderer.page(
            "config.html",
            request,
            config=config,
            commands=_commands(config),
            reloaded_at=day_and_time(config.at) if config.at else "",
            applied=await self._applied.rows(request),
        )

    async def reload(self, request: web.Request) -> web.Response:
        """Read the file again; the page shows the outcome.

        Raises:
            Unready: the gateway does not get to it.
        """
        await reload(self._operator, Nothing(), asker_of(request))
        raise web.HTTPSeeOther("/config")


def _commands(config: ConfigView) -> Sequence[str]:
    """List the commands that change, check and use the file; a service belongs to a user of its own."""
    file = quote(config.file)
    edit, order = ("sudoedit", "sudo ") if config.is_service else ('"${EDITOR:-nano}"', "")
    return f"{edit} {file}", f"modbus-gateway check {file}", f"{order}modbus-gateway reload"
