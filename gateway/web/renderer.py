"""How pages are made of templates."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Protocol

from aiohttp import web
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gateway import __version__
from gateway.ports.threads import ThreadPerCall
from gateway.web.assets import Assets
from gateway.web.guard import VISITOR, Need
from gateway.web.problems import Handler

FOLDER: Final = Path(__file__).parent / "templates"


class Page(Protocol):
    """A page, or some that belong together."""

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """Method, path, handler, and what it needs."""


class Renderer:
    """Makes pages, one at a time and in a thread: the lines do not wait for them."""

    def __init__(self, assets: Assets) -> None:
        self._one_at_a_time = asyncio.Lock()
        self._templates = Environment(
            loader=FileSystemLoader(FOLDER), autoescape=True, undefined=StrictUndefined, auto_reload=False
        )
        self._templates.globals["asset"] = assets.address
        self._templates.globals["version"] = __version__

    async def page(self, template: str, request: web.Request, **content: Any) -> web.Response:
        """The page that a template makes of this content, for who has sent the request."""
        text = await self._rendered(template, {"visitor": request[VISITOR], "path": request.path, **content})
        return web.Response(text=text, content_type="text/html", headers={"Cache-Control": "no-store"})

    async def _rendered(self, template: str, content: dict[str, Any]) -> str:
        loop = asyncio.get_running_loop()
        async with self._one_at_a_time:
            return await loop.run_in_executor(
                ThreadPerCall("web page"), lambda: self._templates.get_template(template).render(content)
            )
