"""The HTTP server: health, readiness and metrics, read-only.

A malicious web page can make a browser send requests here under a host name of its own that resolves to this address
(DNS rebinding). So a request is answered only if its Host is an address, `localhost`, or one of the `hosts`.
"""

import asyncio
import hmac
import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import ip_address
from typing import Final, Protocol, cast
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

#: Concurrent connections; more are closed at once.
MOST_CONNECTIONS: Final = 32
#: How long a connection may be idle between two requests, and how long stopping waits for requests, in seconds.
IDLE: Final = 75.0
_SHUTDOWN: Final = 1.0

#: The logger for aiohttp's complaints about clients that do not send HTTP: not shown.
_SILENT: Final = logging.getLogger(__name__)
_SILENT.disabled = True

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True, slots=True)
class WebSettings:
    """Where the server listens, and who has access: with a `token`, metrics are only for clients that send it."""

    host: str
    port: int
    hosts: tuple[str, ...] = ()
    token: str = ""


class Answers(Protocol):
    """The server's view of the gateway."""

    #: The type of `metrics`, for the response.
    content_type: str

    async def metrics(self) -> bytes:
        """The metrics, as text."""

    def trouble(self) -> str:
        """Why the gateway is not ready; empty if it is."""

    def failed(self, error: Exception) -> None:
        """An unexpected error ended a request."""


@asynccontextmanager
async def web_open(settings: WebSettings, answers: Answers) -> AsyncIterator[str]:
    """Run the server inside the context; yields its address.

    Raises:
        OSError: the address cannot be used.
    """
    app = web.Application(middlewares=[_problems(answers), _guard(settings)], client_max_size=1024)
    app.router.add_get("/healthz", _healthz)
    app.router.add_get("/readyz", _readyz(answers))
    app.router.add_get("/metrics", _metrics(answers))
    runner = web.AppRunner(app, access_log=None, logger=_SILENT, keepalive_timeout=IDLE, shutdown_timeout=_SHUTDOWN)
    await runner.setup()
    server = None
    try:
        server = await asyncio.get_running_loop().create_server(_bounded(runner), settings.host, settings.port)
        host, port = server.sockets[0].getsockname()[:2]
        yield f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
    finally:
        if server is not None:
            server.close()
        await runner.cleanup()


class _TooMany(asyncio.Protocol):
    """A connection beyond the limit: closed at once."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()


def _bounded(runner: web.AppRunner) -> Callable[[], asyncio.Protocol]:
    server = cast("web.Server", runner.server)
    return lambda: server() if len(server.connections) < MOST_CONNECTIONS else _TooMany()


async def _healthz(_request: web.Request) -> web.Response:
    return web.Response(text="ok\n")


def _readyz(answers: Answers) -> _Handler:
    async def readyz(_request: web.Request) -> web.Response:
        trouble = answers.trouble()
        if trouble:
            raise web.HTTPServiceUnavailable(text=trouble)
        return web.Response(text="ready\n")

    return readyz


def _metrics(answers: Answers) -> _Handler:
    one_at_a_time = asyncio.Lock()

    async def metrics(_request: web.Request) -> web.Response:
        async with one_at_a_time:
            body = await answers.metrics()
        return web.Response(body=body, headers={"Content-Type": answers.content_type, "Cache-Control": "no-store"})

    return metrics


def _guard(settings: WebSettings) -> Middleware:
    """Reject requests for other hosts, and those without a token where one is needed."""
    known = {"localhost", *(host.lower() for host in settings.hosts)}
    expected = f"Bearer {settings.token}".encode()

    @web.middleware
    async def guard(request: web.Request, handler: _Handler) -> web.StreamResponse:
        if not _is_ours(request.host, known):
            raise web.HTTPMisdirectedRequest(text="this host is not among the hosts of [web]")
        if settings.token and request.path not in {"/healthz", "/readyz"}:
            given = request.headers.get("Authorization", "").encode(errors="surrogateescape")
            if not hmac.compare_digest(given, expected):
                raise web.HTTPUnauthorized(headers={"WWW-Authenticate": "Bearer"}, text="the token is needed")
        return await handler(request)

    return guard


def _is_ours(host: str, known: set[str]) -> bool:
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name in known or bool(ip_address(name))
    except ValueError:
        return False


def _problems(answers: Answers) -> Middleware:
    """Errors as problem details (RFC 9457)."""

    @web.middleware
    async def problems(request: web.Request, handler: _Handler) -> web.StreamResponse:
        try:
            return await handler(request)
        except web.HTTPError as error:
            return _problem(error)
        except Exception as error:  # noqa: BLE001 - the error boundary of a request
            answers.failed(error)
            return _problem(web.HTTPInternalServerError(text="a defect in the gateway; its log says more"))

    return problems


def _problem(error: web.HTTPError) -> web.Response:
    title = HTTPStatus(error.status).phrase
    detail = error.text if error.text and not error.text.startswith(str(error.status)) else title
    body = json.dumps({"type": "about:blank", "title": title, "status": error.status, "detail": detail})
    headers = {name: error.headers[name] for name in ("Allow", "WWW-Authenticate") if name in error.headers}
    return web.Response(text=body, status=error.status, headers=headers, content_type="application/problem+json")
