"""The paths of pages."""

from typing import Literal
from urllib.parse import quote

from aiohttp import web

from gateway.operator.operations.answers.unit import UnitPicture


def path_of(kind: Literal["units", "images"], unit: UnitPicture) -> str:
    """Return the path of the page of a unit or image; paths below it begin with this."""
    return f"/{kind}/{quote(unit.name or str(unit.unit), safe='')}"


def page_of(unit: UnitPicture) -> str:
    """Return the path of the page that shows a unit."""
    return path_of("units" if unit.is_asked else "images", unit)


def see_other(target: str) -> web.Response:
    """Answer a form: the browser shows `target`, and reloading that sends nothing again."""
    return web.Response(status=303, headers={"Location": target})
