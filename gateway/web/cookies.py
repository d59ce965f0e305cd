"""The cookies of a request, and those that keep what a visitor has chosen."""

from http.cookies import CookieError
from typing import Final

from aiohttp import web

#: How long a browser keeps a choice, in seconds.
_KEPT: Final = 365 * 24 * 3600


def cookie(request: web.Request, name: str) -> str:
    """The value of a cookie; empty if there is none, or if the header is malformed."""
    try:
        return request.cookies.get(name, "")
    except CookieError:
        return ""


def keep(request: web.Request, response: web.Response, name: str, value: str, *, is_encrypted: bool) -> None:
    """Let the browser keep a choice, unless it has it already."""
    if value != cookie(request, name):
        response.set_cookie(name, value, max_age=_KEPT, path="/", secure=is_encrypted, httponly=True, samesite="Lax")
