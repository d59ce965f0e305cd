"""The page of the config: shown and checked here, edited in its file."""

from collections.abc import Sequence
from shlex import quote

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.operator.config.applied import AppliedViewer
from gateway.operator.config.reload import reload
from gateway.operator.config.view import ConfigView, ConfigViewer
from gateway.operator.operations.operation import Nothing
from gateway.web.access.guard import VISITOR
from gateway.web.api.asking import asker_of
from gateway.web.front.problems import ProblemError
from gateway.web.front.turns import Turns
from gateway.web.pages.page import Page, Shown, route
from gateway.web.pages.times import day_and_time


class ConfigPage(Page):
    """The handlers of `/config`."""

    def __init__(self, shown: Shown) -> None:
        super().__init__(shown)
        operator = shown.operator
        self._viewer = ConfigViewer(operator.running, operator.reloader, operator.clock)
        self._applied = AppliedViewer(operator.reloader)
        self._turns = Turns()

    @route("GET", "/config")
    async def show(self, request: web.Request) -> web.Response:
        """Show what is in use, what the file says now, and the outcome of the last reload."""
        async with self._turns.turn(request):
            config = await self._viewer.view()
            applied = await in_thread("web config", self._applied.rows)
        return await self._renderer.page(
            "config.html",
            request,
            config=config,
            commands=_commands(config),
            reloaded_at=day_and_time(config.at) if config.at else "",
            applied=[(each, day_and_time(each.at.timestamp())) for each in applied],
        )

    @route("GET", "/config/applied/{name}")
    async def show_applied(self, request: web.Request) -> web.Response:
        """Show a config that was in use before.

        Raises:
            ProblemError: 403, whoever asks is no operator; 404, it is not kept any more.
        """
        if request[VISITOR].role != "operator":
            raise ProblemError(403, "configs that were in use before are shown to operators")
        async with self._turns.turn(request):
            view = await in_thread("web config", self._applied.view, request.match_info["name"])
        if view is None:
            raise ProblemError(404, "this config is not kept any more: the last ten are")
        return await self._renderer.page("applied.html", request, view=view, at=day_and_time(view.at.timestamp()))

    @route("POST", "/config/reload", "operator")
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
