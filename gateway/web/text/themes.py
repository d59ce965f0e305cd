"""The theme of the pages: light, dark, or what the visitor's system has (`auto`)."""

from collections.abc import Mapping
from typing import Final

from aiohttp import web

from gateway.web.text.cookies import cookie, keep

#: What a browser keeps the choice in.
COOKIE: Final = "mbgw-theme"
#: The themes, and for which media the dark colours apply.
DARK: Final[Mapping[str, str]] = {"auto": "(prefers-color-scheme: dark)", "light": "not all", "dark": "all"}


def theme_of(request: web.Request) -> str:
    """Choose the theme that the address asks for (`?theme=dark`), or the cookie; `auto` without either."""
    wanted = (request.query.get("theme", ""), cookie(request, COOKIE))
    return next((theme for theme in wanted if theme in DARK), "auto")


def keep_theme(request: web.Request, response: web.Response, *, is_encrypted: bool) -> None:
    """Let the browser keep the theme that its user has chosen by an address."""
    if request.query.get("theme", "") in DARK:
        keep(request, response, COOKIE, request.query["theme"], is_encrypted=is_encrypted)
