"""The HTTP routes below /api/v1 that the table of operations makes."""

import asyncio
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from typing import Any, Final

from aiohttp import web

from gateway.clock.slices import turn
from gateway.errors import NotPermitted
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.running import Reloaded
from gateway.operator.operations.answers.status import Status
from gateway.operator.operations.json_text import json_text
from gateway.operator.operations.operation import Asker, Operation
from gateway.operator.operations.parameters import Parameter, fields_of, parameters_of
from gateway.operator.operations.writing import written
from gateway.operator.operator import Operator
from gateway.runtime.garbage import no_collection
from gateway.web.access.guard import Need
from gateway.web.api.asking import asker_of, parameters_in
from gateway.web.front.problems import Handler, ProblemError

#: Below this path are all operations.
ROOT: Final = "/api/v1"
#: Operations; those with a path have a route here.
Operations = Sequence[Operation[Any, Any]]

_WRITE: Final = json.JSONEncoder(default=fields_of, ensure_ascii=False).encode
#: A parameter in the path of an operation.
NAMED: Final = re.compile(r"\{(\w+)\}")
#: The last parameter of a path, which may be left out with what joins it to the one before.
_LAST: Final = re.compile(r"-\{(\w+)\}$")


def operation_routes(
    operator: Operator, operations: Operations, *, may_write: bool
) -> Iterator[tuple[str, str, Handler, Need]]:
    """List the routes of operations: method, path, handler, and what it needs. Values are written if `may_write`."""
    for each in operations:
        if each.path is not None:
            handle = _Handler(each, operator, may_write=may_write).handle
            need: Need = "reading" if each.right == "reading" else "operator"
            yield from ((each.method, path, handle, need) for path in _paths(each))


class _Handler:
    """The handler of one operation."""

    def __init__(self, operation: Operation[Any, Any], operator: Operator, *, may_write: bool) -> None:
        self._operation = operation
        self._operator = operator
        self._may_write = may_write
        self._in_path = frozenset(NAMED.findall(operation.path or ""))
        #: The status that was written last, and its body: it is the same for all who ask within a second.
        self._status: Status | None = None
        self._body = b""
        self._one_status_at_a_time = asyncio.Lock()

    async def handle(self, request: web.Request) -> web.Response:
        """Carry out the operation that a request asks for.

        Raises:
            WrongQuestion, ProblemError: it cannot be carried out.
        """
        if self._operation.right == "writing" and not self._may_write:
            raise NotPermitted("nothing is written over HTTP without write = true in [web]")
        asked = await parameters_in(request, self._operation.parameters, self._in_path)
        await self._operation.load()
        await turn()
        with no_collection() if self._operation.is_large else nullcontext():
            body = await self._answer(asked, asker_of(request))
        return json_response(body)

    async def _answer(self, asked: object, asker: Asker) -> bytes:
        answer = await self._operation.answer(self._operator, asked, asker)
        if isinstance(answer, Reloaded) and not answer.ok:
            raise _not_reloaded(answer)
        writing = self._written_once(answer) if isinstance(answer, Status) else written(answer, _WRITE)
        del answer
        return await writing

    async def _written_once(self, status: Status) -> bytes:
        async with self._one_status_at_a_time:
            if status is not self._status:
                self._body = await written(status, _WRITE)
                self._status = status
            return self._body


def json_of(body: object) -> bytes:
    """Write dataclasses and JSON values as JSON in UTF-8."""
    return json_text(body, _WRITE)


def json_response(body: bytes) -> web.Response:
    """Make a response from JSON."""
    headers = {"Cache-Control": "no-store"}
    return web.Response(body=body, content_type="application/json", charset="utf-8", headers=headers)


def _not_reloaded(outcome: Reloaded) -> ProblemError:
    if outcome.problems:
        return ProblemError(422, outcome.problems[0], problems=outcome.problems)
    return ProblemError(500, outcome.defect)


def _paths(operation: Operation[Any, Any]) -> Iterator[str]:
    """List the paths of an operation for the router: two if the last parameter in it may be left out."""
    known = {each.name: each for each in parameters_of(operation.parameters)}
    path = f"{ROOT}{operation.path}"
    last = _LAST.search(path)
    for each in (path, path[: last.start()]) if last and not known[last[1]].is_required else (path,):
        yield NAMED.sub(lambda named: f"{{{named[1]}{_pattern(known[named[1]])}}}", each)


def _pattern(parameter: Parameter) -> str:
    """Return the pattern of a parameter in a path; empty for any text."""
    if Area in parameter.types:
        return f":{'|'.join(Area)}"
    return ":[0-9]{1,5}" if int in parameter.types and str not in parameter.types else ""
