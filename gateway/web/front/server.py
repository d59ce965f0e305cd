"""The HTTP server: pages, API, health, readiness and metrics."""

import logging
import socket
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import aclosing, asynccontextmanager
from functools import partial
from typing import Final, cast

from aiohttp import web

from gateway.events import WebUsersRejected
from gateway.observe.fan_out import FanOut
from gateway.operator.operations.table import OPERATIONS
from gateway.operator.operator import Operator
from gateway.tools.examinations import Examinations
from gateway.tools.page_scans import PageScans
from gateway.web.access.guard import Guard, Need
from gateway.web.access.sessions import Sessions
from gateway.web.access.tokens import Tokens
from gateway.web.access.user_table import UserTable
from gateway.web.api.api import Api
from gateway.web.api.operations import Operations
from gateway.web.front.connections import Connect, Connections, listen
from gateway.web.front.machines import machine_routes
from gateway.web.front.problems import Handler, problems
from gateway.web.front.settings import HEADERS, WebSettings
from gateway.web.front.streams import Streams
from gateway.web.pages.add_line import AddLinePage
from gateway.web.pages.assets import Assets
from gateway.web.pages.clients import ClientsPage
from gateway.web.pages.config import ConfigPage
from gateway.web.pages.config_change import ConfigChangePage
from gateway.web.pages.events import EventsPage
from gateway.web.pages.head import Heads
from gateway.web.pages.health import HealthPage
from gateway.web.pages.image import ImagePage
from gateway.web.pages.line import LinePage
from gateway.web.pages.login import LoginPage
from gateway.web.pages.overview import OverviewPage
from gateway.web.pages.page import Page, Shown
from gateway.web.pages.problem import problem_pages
from gateway.web.pages.renderer import Renderer
from gateway.web.pages.sites import SitesPage
from gateway.web.pages.situation import Situations
from gateway.web.pages.traffic import TrafficPage
from gateway.web.pages.unit import UnitPage
from gateway.web.pages.values import ValuesPage
from gateway.web.pages.write_rights import WriteRights
from gateway.web.pages.writing import WritePages

#: How long a connection may be idle between two requests, and how long the end waits for requests, in seconds.
IDLE: Final = 75.0
_SHUTDOWN: Final = 1.0
#: The largest request body, in bytes: 1968 coils as JSON.
_LARGEST_BODY: Final = 32 * 1024
#: The longest first line, in bytes: finding a route for thousands of slashes takes long.
_LONGEST_LINE: Final = 2048
#: The most parameters in an address: what they cost is paid before any login.
_MOST_PARAMETERS: Final = 32

#: Without HEAD: streams, which end only when the reader leaves, and a file whose head costs as much as all of it.
_STREAMS: Final = frozenset({"/api/v1/events", "/api/v1/trace", "/api/v1/trace.pcapng"})

#: What takes a whole config in its body.
_LONG_BODIES: Final = frozenset({"/api/v1/config/check", "/config/change", "/config/change/text"})

_PAGES: Final[tuple[Callable[[Shown], Page], ...]] = (
    *(OverviewPage, ValuesPage, LinePage, EventsPage, TrafficPage, UnitPage, ImagePage, WritePages, ClientsPage),
    *(SitesPage, HealthPage, ConfigPage, ConfigChangePage, AddLinePage),
)

#: The logger for aiohttp's complaints about clients that do not send HTTP: not shown.
_SILENT: Final = logging.getLogger(__name__)
_SILENT.disabled = True


@asynccontextmanager
async def web_open(
    settings: WebSettings, operator: Operator, fan_out: FanOut, taken: Iterable[socket.socket] = ()
) -> AsyncIterator[str]:
    """Run the server inside the context; yield its address. Addresses of `taken` sockets are refused.

    Raises:
        OSError: the address or the file with the users cannot be used.
        UsersError: others may read or change that file, or a line of it is invalid.
    """
    async with serving(settings, operator, fan_out) as connect:
        acceptor = await listen(settings.host, settings.port, partial(connect, settings.tls), taken)
        host, port = acceptor.sockets[0].getsockname()[:2]
        try:
            yield f"http{'s' if settings.is_encrypted else ''}://{f'[{host}]' if ':' in host else host}:{port}"
        finally:
            acceptor.stop()


@asynccontextmanager
async def serving(
    settings: WebSettings, operator: Operator, fan_out: FanOut, operations: Operations = OPERATIONS
) -> AsyncIterator[Connect]:
    """Serve connections inside the context; yield what makes the protocol of each, with or without TLS."""
    emit = operator.running.emit
    table = UserTable(settings.users, lambda reason: emit(WebUsersRejected(reason)))
    async with (
        table.kept_up_to_date(),
        aclosing(Examinations(operator.running, operator.clock)) as doctor,
        aclosing(PageScans(operator)) as scans,
    ):
        streams = Streams()

        def serve() -> web.RequestHandler:
            return cast("web.Server", runner.server)()

        connections = Connections(serve)
        runner = web.AppRunner(
            _application(settings, operator, operations, fan_out, doctor, scans, table, streams, connections),
            access_log=None,
            logger=_SILENT,
            keepalive_timeout=IDLE,
            shutdown_timeout=_SHUTDOWN,
            lingering_time=0,  # a body that no handler has read is not parsed
            read_bufsize=_LARGEST_BODY // 2,  # twice as much may wait for its handler
            max_line_size=_LONGEST_LINE,
            auto_decompress=False,  # no client of ours packs what it sends, and 32 KiB can become 30 MB
        )
        await runner.setup()
        try:
            yield connections.connected
        finally:
            connections.close()
            streams.end()
            await runner.cleanup()


def _application(
    settings: WebSettings,
    operator: Operator,
    operations: Operations,
    fan_out: FanOut,
    doctor: Examinations,
    scans: PageScans,
    table: UserTable,
    streams: Streams,
    connections: Connections,
) -> web.Application:
    sessions = Sessions()
    tokens = Tokens(settings.token, table, operator.running.emit)
    guard = Guard(settings, table, sessions, tokens, operator.running.emit)
    api = Api(operator, operations, fan_out, guard, streams, may_write=settings.write)
    assets = Assets()
    situations = Situations(operator, doctor)
    renderer = Renderer(assets, Heads(operator, situations), is_encrypted=settings.is_encrypted)
    shown = Shown(
        operator=operator,
        renderer=renderer,
        situations=situations,
        rights=WriteRights(operator, may_write=settings.write),
        doctor=doctor,
        scans=scans,
    )
    pages = (*(page(shown) for page in _PAGES), LoginPage(shown, settings, guard, table, sessions))
    routes = [
        *machine_routes(operator.running),
        *api.routes(),
        *(route for page in pages for route in page.routes()),
        ("GET", "/static/{name:.+}", assets.serve, "nothing"),
    ]
    needs: dict[object, Need] = {handler: need for _, _, handler, need in routes}
    app = web.Application(
        middlewares=[
            connections.middleware,
            _bound_query,
            problem_pages(renderer, guard.visitor),
            problems(operator.running.emit),
            guard.middleware(needs, _LONG_BODIES),
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


@web.middleware
async def _bound_query(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Refuse more parameters than a page of ours has, before anything looks at them."""
    if request.rel_url.raw_query_string.count("&") >= _MOST_PARAMETERS:
        return web.Response(status=414, text=f"at most {_MOST_PARAMETERS} parameters\n")
    return await handler(request)


async def _add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)
