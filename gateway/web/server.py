"""The HTTP server: pages, API, health, readiness and metrics."""

import asyncio
import logging
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager
from functools import partial
from typing import Final, cast
from weakref import WeakSet

from aiohttp import web

from gateway.listeners.origin import Origins
from gateway.web.answers import Answers
from gateway.web.api import Api
from gateway.web.assets import Assets
from gateway.web.guard import Guard, Need
from gateway.web.pages.clients import ClientsPage
from gateway.web.pages.config import ConfigPage
from gateway.web.pages.health import HealthPage
from gateway.web.pages.heat_map import HeatMap
from gateway.web.pages.image import ImagePage
from gateway.web.pages.line import LinePage
from gateway.web.pages.login import LoginPage
from gateway.web.pages.overview import OverviewPage
from gateway.web.pages.problem import problem_pages
from gateway.web.pages.traffic import TrafficPage
from gateway.web.pages.unit import UnitPage
from gateway.web.pages.writing import WritePages, WriteRights
from gateway.web.problems import Handler, problems
from gateway.web.renderer import Page, Renderer
from gateway.web.sessions import Sessions
from gateway.web.settings import HEADERS, WebSettings
from gateway.web.shared_reads import SharedReads
from gateway.web.streams import Streams
from gateway.web.user_table import UserTable

#: Connections at a time. For a new one, an address that has more than so many loses its oldest; otherwise it is closed
#: itself at once. Browsers open six.
MOST_CONNECTIONS: Final = 128
MOST_OF_ONE_ADDRESS: Final = 8
#: How long a connection may be idle between two requests, and how long the end waits for requests, in seconds.
IDLE: Final = 75.0
_SHUTDOWN: Final = 1.0
#: How long a connection may take for its first request, and for its TLS handshake, in seconds.
FIRST_REQUEST_WITHIN: Final = 20.0
_HANDSHAKE: Final = 5.0
#: The largest request body, in bytes: 1968 coils as JSON.
_LARGEST_BODY: Final = 32 * 1024

#: What ends only when its reader leaves, or costs as much for its head as for all of it.
_STREAMS: Final = frozenset({"/api/v1/events", "/api/v1/trace", "/api/v1/trace.pcapng"})

#: The logger for aiohttp's complaints about clients that do not send HTTP: not shown.
_SILENT: Final = logging.getLogger(__name__)
_SILENT.disabled = True


@asynccontextmanager
async def web_open(settings: WebSettings, answers: Answers) -> AsyncIterator[str]:
    """Run the server inside the context; yields its address.

    Raises:
        OSError: the address or the file with the users cannot be used.
        UsersError: a line of that file is none of a user.
    """
    tls = settings.tls
    async with serving(settings, answers) as connected:
        server = await asyncio.get_running_loop().create_server(
            connected,
            settings.host,
            settings.port,
            ssl=tls,
            ssl_handshake_timeout=None if tls is None else _HANDSHAKE,
        )
        host, port = server.sockets[0].getsockname()[:2]
        try:
            yield f"http{'' if tls is None else 's'}://{f'[{host}]' if ':' in host else host}:{port}"
        finally:
            server.close()


@asynccontextmanager
async def serving(settings: WebSettings, answers: Answers) -> AsyncIterator[Callable[[], asyncio.Protocol]]:
    """In its context connections are served; what makes the protocol of each of them."""
    table = UserTable(settings.users, answers.users_rejected)
    async with table.kept_up_to_date():
        streams, connections = Streams(), _Connections()
        runner = web.AppRunner(
            _application(settings, answers, table, streams, connections),
            access_log=None,
            logger=_SILENT,
            keepalive_timeout=IDLE,
            shutdown_timeout=_SHUTDOWN,
            auto_decompress=False,  # no client of ours packs what it sends, and 32 KiB can become 30 MB
        )
        await runner.setup()
        try:
            yield connections.bounded(runner)
        finally:
            streams.end()
            await runner.cleanup()


def _application(
    settings: WebSettings, answers: Answers, table: UserTable, streams: Streams, connections: "_Connections"
) -> web.Application:
    sessions = Sessions()
    guard = Guard(settings, table, sessions)
    reads = SharedReads(answers, asyncio.get_running_loop().time)
    api = Api(answers, guard, streams, reads, may_write=settings.write)
    assets = Assets()
    renderer = Renderer(assets, is_encrypted=settings.is_encrypted)
    heat_map = HeatMap()
    rights = WriteRights(answers, may_write=settings.write)
    units = UnitPage(answers, renderer, reads, rights)
    pages: tuple[Page, ...] = (
        OverviewPage(answers, renderer, heat_map),
        LinePage(answers, renderer, heat_map),
        TrafficPage(answers, renderer),
        units,
        ImagePage(answers, renderer, units, rights),
        WritePages(answers, renderer, reads, rights),
        ClientsPage(answers, renderer),
        HealthPage(answers, renderer),
        ConfigPage(answers, renderer),
        LoginPage(settings, answers, guard, table, sessions, renderer),
    )
    routes = [
        *_of_machines(answers),
        *api.routes(),
        *(route for page in pages for route in page.routes()),
        ("GET", "/static/{name:.+}", assets.serve, "nothing"),
    ]
    needs: dict[object, Need] = {handler: need for _, _, handler, need in routes}
    app = web.Application(
        middlewares=[
            connections.middleware,
            problem_pages(renderer, guard.visitor),
            problems(answers),
            guard.middleware(needs),
        ],
        client_max_size=_LARGEST_BODY,
    )
    for method, path, handler, _ in routes:
        if method == "GET":
            app.router.add_get(path, handler, allow_head=path not in _STREAMS)
        else:
            app.router.add_route(method, path, handler)
    app.on_response_prepare.append(_add_headers)
    return app


def _of_machines(answers: Answers) -> Sequence[tuple[str, str, Handler, Need]]:
    """What programs ask without an API."""
    one_at_a_time = asyncio.Lock()

    async def healthz(_request: web.Request) -> web.Response:
        return web.Response(text="ok\n")

    async def readyz(_request: web.Request) -> web.Response:
        trouble = answers.trouble()
        if trouble:
            raise web.HTTPServiceUnavailable(text=trouble)
        return web.Response(text="ready\n")

    async def metrics(_request: web.Request) -> web.Response:
        async with one_at_a_time:
            body = await answers.metrics()
        return web.Response(body=body, headers={"Content-Type": answers.content_type, "Cache-Control": "no-store"})

    return [
        ("GET", "/healthz", healthz, "nothing"),
        ("GET", "/readyz", readyz, "nothing"),
        ("GET", "/metrics", metrics, "metrics"),
    ]


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


class _TooMany(asyncio.Protocol):
    """A connection for which there is no room."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        cast("asyncio.Transport", transport).abort()


class _Connections:
    """The connections: a bounded number, and each of them asks something soon."""

    def __init__(self) -> None:
        self._served: WeakSet[asyncio.BaseTransport] = WeakSet()
        self._origins = Origins()

    def bounded(self, runner: web.AppRunner) -> Callable[[], asyncio.Protocol]:
        """Makes the protocols of new connections."""
        server = cast("web.Server", runner.server)
        loop = asyncio.get_running_loop()

        def connected() -> asyncio.Protocol:
            if len(server.connections) >= MOST_CONNECTIONS and not self._make_room(server.connections, loop.time()):
                return _TooMany()
            protocol = server()
            loop.call_later(FIRST_REQUEST_WITHIN, partial(self._close_if_silent, protocol))
            return protocol

        return connected

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Notes who has asked something."""
        if request.transport is not None:
            self._served.add(request.transport)
        return await handler(request)

    def _make_room(self, connections: Iterable[web.RequestHandler], now: float) -> bool:
        """Close the oldest connection of the address that has most of them; False if all have few."""
        by_origin: defaultdict[str, list[asyncio.Transport]] = defaultdict(list)
        for each in connections:
            if each.transport is not None and not each.transport.is_closing():
                host, *_ = each.transport.get_extra_info("peername") or ("",)
                by_origin[self._origins.of(host.partition("%")[0], now)].append(each.transport)
        most = max(by_origin.values(), key=len, default=[])
        if len(most) > MOST_OF_ONE_ADDRESS:
            most[0].abort()
        return len(most) > MOST_OF_ONE_ADDRESS

    def _close_if_silent(self, protocol: web.RequestHandler) -> None:
        if protocol.transport is not None and protocol.transport not in self._served:
            protocol.transport.abort()
