"""The cookies of a request."""

from http.cookies import CookieError

from aiohttp import web


def cookie(request: web.Request, name: str) -> str:
    """The value of a cookie; empty if there is none, or if the header is malformed."""
    try:
        return request.cookies.get(name, "")
    except CookieError:
        return ""
