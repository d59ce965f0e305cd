"""Problems as pages, for browsers."""

import json
from collections.abc import Callable
from typing import Final
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from gateway.web.access.guard import VISITOR, Visitor
from gateway.web.front.problems import Handler
from gateway.web.front.turns import is_there
from gateway.web.pages.renderer import Renderer

#: What only programs ask for.
_OF_PROGRAMS: Final = ("/api/", "/metrics", "/healthz", "/readyz", "/static/")
#: What the guard lets pass: there is no such path, or no such method.
_NO_SUCH: Final = frozenset({404, 405})
_REFUSED: Final = frozenset({400, 401, 403, 404, 408, 413, 421, 422})


def problem_pages(renderer: Renderer, visitor_of: Callable[[web.Request], Visitor]) -> Middleware:
    """Make the middleware that shows a problem as a page to a browser that asks for pages."""

    @web.middleware
    async def as_pages(request: web.Request, handler: Handler) -> web.StreamResponse:
        response = await handler(request)
        if not isinstance(response, web.Response) or response.content_type != "application/problem+json":
            return response
        if not is_there(request):
            return response
        if "text/html" not in request.headers.get("Accept", "") or request.path.startswith(_OF_PROGRAMS):
            return response
        if VISITOR not in request:
            is_ours = response.status in _NO_SUCH
            request[VISITOR] = visitor_of(request) if is_ours else Visitor("")
        problem = json.loads(response.text or "{}")
        is_refused_form = request.method == "POST" and response.status in _REFUSED
        page = await renderer.page(
            "problem.html", request, problem=problem, back=_back(request), is_refused_form=is_refused_form
        )
        page.set_status(response.status)
        page.headers.update(
            {name: response.headers[name] for name in ("Allow", "Retry-After") if name in response.headers}
        )
        return page

    return as_pages


def _back(request: web.Request) -> str:
    """Find the page of ours that the request comes from; the first page if there is none."""
    referer = urlsplit(request.headers.get("Referer", ""))
    is_ours = referer.netloc.lower() == request.host.lower() and referer.path.startswith("/")
    is_path = is_ours and not referer.path.startswith("//") and referer.path.isascii() and referer.path != request.path
    return referer.path if is_path else "/"
