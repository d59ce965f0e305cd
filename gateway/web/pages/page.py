"""What all pages have: what they show of a gateway and how, and which of their methods handles which requests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.operator.operator import Operator
from gateway.tools.examinations import Examinations
from gateway.tools.page_scans import PageScans
from gateway.web.access.guard import Need
from gateway.web.front.problems import Handler
from gateway.web.pages.heat_map import HeatMap
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.situation import Situations
from gateway.web.pages.write_rights import WriteRights

Method = TypeVar("Method", bound=Callable[..., object])
_ROUTE = "_route"


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What pages show of a gateway, and what makes them."""

    operator: Operator
    renderer: Renderer
    situations: Situations
    rights: WriteRights
    doctor: Examinations
    scans: PageScans
    heat_map: HeatMap = field(default_factory=HeatMap)


def route(method: str, path: str, need: Need = "page") -> Callable[[Method], Method]:
    """Have the method of a Page handle requests to this path, of visitors who meet the `need`."""

    def marked(handler: Method) -> Method:
        setattr(handler, _ROUTE, (method, path, need))
        return handler

    return marked


class Page:
    """A page, or some that belong together."""

    def __init__(self, shown: Shown) -> None:
        self._operator = shown.operator
        self._renderer = shown.renderer
        self._situations = shown.situations
        self._rights = shown.rights
        self._doctor = shown.doctor
        self._scans = shown.scans
        self._heat_map = shown.heat_map

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List its routes: method, path, handler, and what it needs."""
        routed = {name: getattr(each, _ROUTE) for name, each in vars(type(self)).items() if hasattr(each, _ROUTE)}
        return [(method, path, getattr(self, name), need) for name, (method, path, need) in routed.items()]


async def csv_file(name: str, written: Callable[[], str]) -> web.Response:
    """Send a file in CSV, written in a thread, with a mark by which spreadsheets know that it is UTF-8."""
    body = await in_thread("web page", lambda: written().encode("utf-8-sig"))
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"', "Cache-Control": "no-store"}
    return web.Response(body=body, content_type="text/csv", charset="utf-8", headers=headers)
