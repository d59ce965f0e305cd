"""Where pages are."""

from typing import Literal
from urllib.parse import quote

from aiohttp import web

from gateway.operator.answers.unit import UnitPicture


def path_of(kind: Literal["units", "images"], unit: UnitPicture) -> str:
    """The path of the page of a unit, or of an image; what is below it follows."""
    return f"/{kind}/{quote(unit.name or str(unit.unit), safe='')}"


def page_of(unit: UnitPicture) -> str:
    """The path of the page that shows a unit."""
    return path_of("units" if unit.kind in ("device", "upstream") else "images", unit)


def see_other(target: str) -> web.Response:
    """The answer to a form: the browser shows `target` then, and reloading that sends nothing again."""
    return web.Response(status=303, headers={"Location": target})
