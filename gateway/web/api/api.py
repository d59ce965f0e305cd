"""The HTTP API below /api/v1: what it answers, as its document (`openapi.py`) says."""

import asyncio
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Final, NoReturn

from aiohttp import web

from gateway.clock.threads import ThreadPerCall
from gateway.errors import WrongQuestion
from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.operator.operations import Traced
from gateway.profiles.point import Point
from gateway.timing.history import LINE_SLOTS, STEP, UNIT_SLOTS
from gateway.web.access.guard import VISITOR, Guard, Need, Visitor
from gateway.web.api.answers import Answers, Status, Unit
from gateway.web.api.asking import ask_for
from gateway.web.api.grid import MOST, grid_of
from gateway.web.api.openapi import document
from gateway.web.api.past import line_past, slots_in, unit_past
from gateway.web.api.reloading import reload
from gateway.web.api.shared_reads import SharedReads
from gateway.web.api.values import Outcome, point_named, read, values_at, write
from gateway.web.front.downloads import Downloads
from gateway.web.front.problems import Handler, ProblemError
from gateway.web.front.streams import Streams

_SPAN: Final = r"{span:\d{1,5}(?:-\d{1,5})?}"
_AREA: Final = f"{{area:{'|'.join(Area)}}}"
_NUMBER: Final = re.compile(r"\d{1,3}")
_DIGITS: Final = re.compile(r"[0-9]{1,5}")
#: A reader of the trace may begin this many seconds before.
LONGEST_LOOK_BACK: Final = 3600
#: How many hours of a history are kept.
MOST_HOURS_OF_A_LINE: Final = LINE_SLOTS * STEP // 3600
MOST_HOURS_OF_A_UNIT: Final = UNIT_SLOTS * STEP // 3600
#: The most records that a sample has in a second.
MOST_PER_SECOND: Final = 2000
#: Points that somebody else has read may be this many seconds old.
LONGEST_AGE: Final = 60


@dataclass(frozen=True, slots=True)
class _Bare:
    """A unit that is not configured: it is asked all the same, and the answer is 0A."""

    unit: int
    name: str = ""
    kind: str = ""
    profile: str = ""
    functions: tuple[int, ...] | None = None
    points: tuple[Point, ...] = ()

    @property
    def limits(self) -> Mapping[int, int]:
        return {}


class Api:
    """The handlers. Values are written only if `may_write`."""

    def __init__(
        self, answers: Answers, guard: Guard, streams: Streams, reads: SharedReads, *, may_write: bool
    ) -> None:
        self._answers = answers
        self._reads = reads
        self._guard = guard
        self._streams = streams
        self._downloads = Downloads()
        self._may_write = may_write
        self._document: dict[str, Any] | None = None
        #: The status that was written last, and its text.
        self._written: Status | None = None
        self._text = ""
        self._one_at_a_time = asyncio.Lock()

    def routes(self) -> Sequence[tuple[str, str, Handler, Need]]:
        """Method, path, handler, and what it needs."""
        units = "/api/v1/units/{unit}"
        return [
            ("GET", "/api/v1/openapi.json", self.openapi, "reading"),
            ("GET", "/api/v1/session", self.session, "reading"),
            ("GET", "/api/v1/status", self.status, "reading"),
            ("GET", "/api/v1/lines", self.lines, "reading"),
            ("GET", "/api/v1/lines/{name}", self.line, "reading"),
            ("GET", "/api/v1/lines/{name}/history", self.line_history, "reading"),
            ("GET", "/api/v1/units", self.units, "reading"),
            ("GET", units, self.unit, "reading"),
            ("GET", f"{units}/history", self.unit_history, "reading"),
            ("GET", f"{units}/points", self.read_points, "reading"),
            ("GET", f"{units}/points/{{name}}", self.read_point, "reading"),
            ("GET", f"{units}/{_AREA}/{_SPAN}", self.read_values, "reading"),
            ("PUT", f"{units}/points", self.write_points, "operator"),
            ("PUT", f"{units}/points/{{name}}", self.write_point, "operator"),
            ("PUT", f"{units}/{_AREA}/{_SPAN}", self.write_values, "operator"),
            ("GET", f"/api/v1/images/{{unit}}/{_AREA}/{_SPAN}", self.image, "reading"),
            ("GET", "/api/v1/events", self.events, "reading"),
            ("GET", "/api/v1/trace", self.trace, "reading"),
            ("GET", "/api/v1/trace.pcapng", self.capture, "reading"),
            ("POST", "/api/v1/reload", self.reload, "operator"),
        ]

    async def openapi(self, _request: web.Request) -> web.Response:
        """The document of this API."""
        if self._document is None:  # made for who asks for it: it takes 10 ms
            self._document = document(self._answers.types, self._guard.cookie)
        return _json(self._document)

    async def session(self, request: web.Request) -> web.Response:
        """Who has logged in, what he may do, and the token that he has to send for it."""
        return _json(session_as_json(request[VISITOR], may_write=self._may_write))

    async def status(self, _request: web.Request) -> web.Response:
        """How the gateway is doing: written once for all who ask within a second, in a thread."""
        async with self._one_at_a_time:
            status = await self._answers.status()
            if status is not self._written:
                loop = asyncio.get_running_loop()
                self._text = await loop.run_in_executor(ThreadPerCall("web status"), _text, status)
                self._written = status
        return _json_response(self._text)

    async def lines(self, _request: web.Request) -> web.Response:
        """The lines, those where we are the server, and other servers."""
        status = await self._answers.status()
        return await _json_of(lambda: {"lines": status.lines, "servers": status.servers, "upstreams": status.upstreams})

    async def line(self, request: web.Request) -> web.Response:
        """One of them."""
        status, name = await self._answers.status(), request.match_info["name"]
        for each in (*status.lines, *status.servers, *status.upstreams):
            if each.name == name:
                return _json(each)
        raise ProblemError(404, f"there is no line {name}")

    async def line_history(self, request: web.Request) -> web.Response:
        """What a line, or another server, did in the last hours."""
        name, hours = request.match_info["name"], _hours(request, MOST_HOURS_OF_A_LINE)
        status = await self._answers.status()
        if all(each.name != name for each in (*status.lines, *status.upstreams)):
            raise ProblemError(404, f"there is no history of a line {name}")
        return await _json_of(partial(line_past, self._answers.past(slots_in(hours)), name))

    async def unit_history(self, request: web.Request) -> web.Response:
        """What a unit on a line, or behind another server, did in the last hours."""
        wanted, hours = _wanted(request), _hours(request, MOST_HOURS_OF_A_UNIT)
        name = wanted if isinstance(wanted, str) else self._answers.unit(wanted).name
        status = await self._answers.status()
        found = next((each for each in status.units if each.name == name), None)
        if found is None:
            raise ProblemError(404, f"there is no history of {self._answers.unit(wanted).name}, which is not on a line")
        return await _json_of(partial(unit_past, self._answers.past(slots_in(hours)), found.line, found.name))

    async def units(self, _request: web.Request) -> web.Response:
        """Every unit, without its points."""
        units = self._answers.units()
        return await _json_of(lambda: {"units": [_without_points(each) for each in units]})

    async def unit(self, request: web.Request) -> web.Response:
        """A unit, with its points and its part of the status."""
        unit, status = self._answers.unit(_wanted(request)), await self._answers.status()
        parts = (*status.units, *status.images, *status.mirrors)
        found = next((each for each in parts if (each.unit, each.name) == (unit.unit, unit.name)), None)
        return _json({**_fields(unit), "status": found})

    async def read_values(self, request: web.Request) -> web.Response:
        """Values by area and addresses."""
        unit, (area, points) = self._any_unit(request), _place(request)
        return _json((await read(unit, points, ask_for(request, self._answers, unit))).as_json(unit, area))

    async def read_points(self, request: web.Request) -> web.Response:
        """All points of a unit that can be read."""
        unit, max_age = self._answers.unit(_wanted(request)), _max_age(request)
        outcome, age = await self._reads.read(
            unit, ask_for(request, self._answers, unit), request[VISITOR].host, max_age
        )
        return _json({**outcome.as_json(unit, None), "age_ms": round(age * 1000, 1)})

    async def image(self, request: web.Request) -> web.Response:
        """What an image or mirror has at some addresses, with ages and last writers; no client's request for it."""
        unit, (area, points) = self._answers.unit(_wanted(request)), _place(request)
        span = Span(area, points[0].address, sum(point.count for point in points))
        if span.count > MOST:
            raise ProblemError(400, f"{span.addresses}: at most {MOST} addresses at a time")
        if not self._answers.may(unit.unit, READERS[area][0], request[VISITOR].host):
            raise ProblemError(403, f"[[access]] does not let {request[VISITOR].client} read {area}", exception=1)
        window = self._answers.image(unit.unit, span)
        if window is None:
            raise ProblemError(404, f"unit {unit.unit} is no image")
        grid = grid_of(window, area, points[0].type, points[0].swap)
        head = {"unit": unit.unit, "name": unit.name, "area": area, "stale_ms": window.stale_ms}
        rows = []
        for _, cells in grid.rows():
            rows.append(_text([cell.as_json() for cell in cells])[1:-1])
            await asyncio.sleep(0)  # a row takes a tenth of a millisecond; the lines come first
        return _json_response(f'{_text(head)[:-1]}, "values": [{", ".join(rows)}]}}')

    async def read_point(self, request: web.Request) -> web.Response:
        """One point."""
        unit, point = self._point(request)
        if point.write == "only":
            raise ProblemError(422, f"{point.name} can be written, but not read")
        return _json((await read(unit, [point], ask_for(request, self._answers, unit))).as_json(unit, None))

    async def write_values(self, request: web.Request) -> web.Response:
        """Write values from an address on."""
        self._check_writing()
        values, unit, (area, points) = await _values(request), self._any_unit(request), _place(request)
        if len(points) != len(values):
            raise ProblemError(400, f"{len(values)} values do not fill {len(points)} places")
        outcome = await self._write(request, unit, points, values)
        return _json(outcome.as_json(unit, area))

    async def write_point(self, request: web.Request) -> web.Response:
        """Write one point."""
        self._check_writing()
        values, (unit, point) = await _values(request), self._point(request)
        if len(values) != 1:
            raise ProblemError(400, f"{point.name} takes one value, not {len(values)}")
        outcome = await self._write(request, unit, [point], values)
        return _json(outcome.as_json(unit, None))

    async def write_points(self, request: web.Request) -> web.Response:
        """Write points that lie side by side, with one request."""
        self._check_writing()
        values, unit = await _values(request), self._answers.unit(_wanted(request))
        named = [value for value in values if isinstance(value, dict) and set(value) == {"point", "value"}]
        if not values or len(named) != len(values):
            raise ProblemError(400, 'each value must be {"point": NAME, "value": VALUE}')
        points = [point_named(unit, str(value["point"])) for value in named]
        outcome = await self._write(request, unit, points, [value["value"] for value in named])
        return _json(outcome.as_json(unit, None))

    async def _write(
        self, request: web.Request, unit: Unit, points: Sequence[Point], values: Sequence[object]
    ) -> Outcome:
        """Write; what was read before is then not given to anybody, even if there was no response."""
        try:
            return await write(unit, points, values, ask_for(request, self._answers, unit))
        finally:
            self._reads.forget(unit)

    async def events(self, request: web.Request) -> web.StreamResponse:
        """The gateway's events as they come."""
        visitor = request[VISITOR]
        with self._answers.events(visitor.host) as source:
            return await self._streams.serve(request, source, visitor, partial(self._guard.is_valid, visitor))

    async def trace(self, request: web.Request) -> web.StreamResponse:
        """What happens on the lines, as it happens."""
        visitor = request[VISITOR]
        asked = which(request.query, usual=0, others=("per_second",))
        source = self._answers.trace(asked, visitor.host, _number(request.query, "per_second", 1, MOST_PER_SECOND))
        return await self._streams.serve(request, source, visitor, partial(self._guard.is_valid, visitor))

    async def capture(self, request: web.Request) -> web.StreamResponse:
        """What has happened, as a file for Wireshark."""
        return await self._downloads.serve(
            request, self._answers.capture(which(request.query, usual=30), request[VISITOR].host)
        )

    async def reload(self, _request: web.Request) -> web.Response:
        """Read the config again."""
        outcome = await reload(self._answers)
        if outcome["problems"]:
            raise ProblemError(422, outcome["problems"][0], problems=outcome["problems"])
        if outcome["defect"]:
            raise ProblemError(500, outcome["defect"])
        return _json(outcome)

    def _check_writing(self) -> None:
        if not self._may_write:
            raise ProblemError(403, "nothing is written over HTTP without write = true in [web]")

    def _any_unit(self, request: web.Request) -> Unit:
        wanted = _wanted(request)
        try:
            return self._answers.unit(wanted)
        except WrongQuestion:
            if not isinstance(wanted, int) or wanted > 255:
                raise
            return _Bare(wanted)

    def _point(self, request: web.Request) -> tuple[Unit, Point]:
        unit = self._answers.unit(_wanted(request))
        return unit, point_named(unit, request.match_info["name"])


def session_as_json(visitor: Visitor, *, may_write: bool) -> dict[str, Any]:
    """A login for programs."""
    may_write = may_write and visitor.role == "operator"
    return {"user": visitor.user, "role": visitor.role, "may_write": may_write, "csrf": visitor.csrf}


def _wanted(request: web.Request) -> int | str:
    return unit_in(request.match_info["unit"])


def unit_in(text: str) -> int | str:
    """The number or the name of a unit in an address."""
    return int(text) if _NUMBER.fullmatch(text) else text


def which(query: Mapping[str, str], usual: int, others: Sequence[str] = ()) -> Traced:
    """Which records of the trace are asked for.

    Raises:
        ProblemError: 400, a parameter is unknown, or no number where it has to be one.
    """
    known = ("line", "unit", "function", "client", "result", "seconds", *others)
    if unknown := sorted(set(query) - set(known)):
        raise ProblemError(400, f"{unknown[0]}: there are only {', '.join(known)}")
    seconds, unit = _number(query, "seconds", 0, LONGEST_LOOK_BACK), query.get("unit")
    return Traced(
        since=usual if seconds is None else seconds,
        line=query.get("line"),
        unit=None if unit is None else unit_in(unit),
        function=_number(query, "function", 1, 127),
        client=query.get("client"),
        result=query.get("result"),
    )


def _number(query: Mapping[str, str], name: str, least: int, most: int) -> int | None:
    text = query.get(name)
    if text is None:
        return None
    if not _DIGITS.fullmatch(text) or not least <= int(text) <= most:
        raise ProblemError(400, f"{name}: a whole number from {least} to {most}")
    return int(text)


def _hours(request: web.Request, most: int) -> int:
    """How far back a history is asked for."""
    query = request.query
    if unknown := sorted(set(query) - {"hours"}):
        raise ProblemError(400, f"{unknown[0]}: there is only hours")
    hours = _number(query, "hours", 1, most)
    return 24 if hours is None else hours


def _place(request: web.Request) -> tuple[Area, list[Point]]:
    first, _, last = request.match_info["span"].partition("-")
    area, query = Area(request.match_info["area"]), request.query
    if unknown := sorted(set(query) - {"type", "swap"}):
        raise ProblemError(400, f"{unknown[0]}: there are only type and swap")
    return area, values_at(
        area, int(first), int(last) if last else None, query.get("type", ""), query.get("swap", "none")
    )


def _max_age(request: web.Request) -> float:
    """How old values may be, in seconds."""
    if unknown := sorted(set(request.query) - {"max_age"}):
        raise ProblemError(400, f"{unknown[0]}: there is only max_age")
    return float(_number(request.query, "max_age", 0, LONGEST_AGE) or 0)


async def _values(request: web.Request) -> list[Any]:
    """The values in the body of a PUT."""
    if request.content_type != "application/json":
        raise ProblemError(415, "the body must be application/json")
    try:
        body = json.loads(await request.read(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise ProblemError(400, "the body is not JSON") from None
    values = body.get("values") if isinstance(body, dict) and set(body) == {"values"} else None
    if not isinstance(values, list) or not values:
        raise ProblemError(400, 'the body must be {"values": [...]}')
    return values


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(name)


def _without_points(unit: Unit) -> dict[str, Any]:
    told = _fields(unit)
    del told["points"]
    return told


def _fields(value: Any) -> dict[str, Any]:
    """A dataclass as its fields: what they hold comes here in its turn, without the copies of `asdict`."""
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _text(body: object) -> str:
    return json.dumps(body, default=_fields, ensure_ascii=False)


def _json(body: object) -> web.Response:
    return _json_response(_text(body))


async def _json_of(make: Callable[[], object]) -> web.Response:
    """What `make` returns; it is called, and written, in a thread."""
    loop = asyncio.get_running_loop()
    return _json_response(await loop.run_in_executor(ThreadPerCall("web API"), lambda: _text(make())))


def _json_response(text: str) -> web.Response:
    return web.Response(text=text, content_type="application/json", headers={"Cache-Control": "no-store"})
