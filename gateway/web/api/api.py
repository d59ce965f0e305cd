"""The HTTP API below /api/v1: the operations, and what only HTTP can do: sessions, streams, files."""

import json
from collections.abc import AsyncIterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from gateway.observe.fan_out import FanOut
from gateway.operator.operations.asked import ToSupport
from gateway.operator.operator import Operator
from gateway.operator.trace.reader import Texts, TraceReader, capture, may_see_all
from gateway.tools.support import make_bundle
from gateway.version import __version__
from gateway.web.access.guard import VISITOR, Guard, Need
from gateway.web.api.asking import asker_of, parameters_in
from gateway.web.api.operations import ROOT, Operations, json_of, json_response, operation_routes
from gateway.web.api.session import session_of
from gateway.web.api.trace import RecordsToCapture, RecordsToFollow
from gateway.web.front.downloads import Downloads
from gateway.web.front.problems import Handler
from gateway.web.front.streams import Streams
from gateway.web.front.turns import Turns

#: The document of this API, as `document.py` has made it.
DOCUMENT: Final = Path(__file__).parent / "openapi.json"
#: The bytes of a file that are sent at a time.
_PART: Final = 64 * 1024


class Api:
    """The handlers of the API. Values are written only if `may_write`."""

    def __init__(
        self,
        operator: Operator,
        operations: Operations,
        fan_out: FanOut,
        guard: Guard,
        streams: Streams,
        *,
        may_write: bool,
    ) -> None:
        self._operator = operator
        self._operations = operations
        self._fan_out = fan_out
        self._guard = guard
        self._streams = streams
        self._downloads = Downloads()
        self._turns = Turns()
        self._texts = Texts()
        self._document = b""
        self._may_write = may_write

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """List the routes: method, path, handler, and what it needs."""
        return [
            *operation_routes(self._operator, self._operations, may_write=self._may_write),
            ("GET", f"{ROOT}/openapi.json", self.openapi, "reading"),
            ("GET", f"{ROOT}/session", self.session, "reading"),
            ("GET", f"{ROOT}/events", self.events, "reading"),
            ("GET", f"{ROOT}/trace", self.trace, "reading"),
            ("GET", f"{ROOT}/trace.pcapng", self.capture, "reading"),
            ("POST", f"{ROOT}/support", self.support, "operator"),
        ]

    async def openapi(self, _request: web.Request) -> web.Response:
        """Return the OpenAPI document."""
        if not self._document:
            document: dict[str, Any] = json.loads(DOCUMENT.read_text(encoding="utf-8"))
            document["info"]["version"] = __version__
            document["components"]["securitySchemes"]["session"]["name"] = self._guard.cookie
            self._document = json_of(document)
        return json_response(self._document)

    async def session(self, request: web.Request) -> web.Response:
        """Return who has logged in, what that user may do, and the token for X-CSRF-Token."""
        return json_response(json_of(session_of(request[VISITOR], may_write=self._may_write)))

    async def events(self, request: web.Request) -> web.StreamResponse:
        """Send the gateway's events as they come."""
        visitor = request[VISITOR]
        with self._fan_out.following(lambda: may_see_all(self._operator.running, visitor.host)) as source:
            return await self._streams.serve(request, source, visitor, partial(self._guard.is_valid, visitor))

    async def trace(self, request: web.Request) -> web.StreamResponse:
        """Send what happens on the lines, as it happens."""
        visitor, asked = request[VISITOR], await parameters_in(request, RecordsToFollow)
        traced = replace(asked.traced, points=asked.points)
        source = TraceReader(self._operator, traced, visitor.host, self._texts, asked.per_second)
        return await self._streams.serve(request, source, visitor, partial(self._guard.is_valid, visitor))

    async def capture(self, request: web.Request) -> web.StreamResponse:
        """Send what has happened on the lines, as a file for Wireshark."""
        asked = await parameters_in(request, RecordsToCapture)
        file = capture(self._operator.running, asked.traced, request[VISITOR].host)
        return await self._downloads.serve(request, file)

    async def support(self, request: web.Request) -> web.StreamResponse:
        """Send a diagnostics bundle; one is made at a time."""
        asked = await parameters_in(request, ToSupport)

        async def parts() -> AsyncIterator[bytes]:
            async with self._turns.turn(request):
                bundle = await make_bundle(self._operator, asked, asker_of(request))
            for at in range(0, len(bundle), _PART):
                yield bundle[at : at + _PART]

        return await self._downloads.serve(request, parts(), "tar.gz")
