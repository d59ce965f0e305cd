"""The asker and the parameters of an operation, from an HTTP request."""

import json
from collections.abc import Callable, Collection
from functools import partial
from typing import Any, NoReturn, TypeVar

from aiohttp import web

from gateway.errors import Malformed
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.asked import OneUnit
from gateway.operator.operations.operation import Asker, IsThere
from gateway.operator.operations.parameters import parameters_of, read_parameters
from gateway.operator.operator import Operator
from gateway.operator.units.units import picture
from gateway.web.access.guard import VISITOR, Visitor
from gateway.web.front.problems import ProblemError
from gateway.web.front.turns import is_there

P = TypeVar("P")


def asker_of(request: web.Request) -> Asker:
    """Make the asker for a request: its visitor, who is there while the connection is."""
    return asker_for(request[VISITOR], partial(is_there, request))


def asker_for(visitor: Visitor, waits: IsThere) -> Asker:
    """Make the asker for a visitor; `waits` returns whether it is still there."""
    return Asker(visitor.caller, waits, visitor.host, "web")


async def parameters_in(request: web.Request, kind: Callable[..., P], in_path: Collection[str] = ()) -> P:
    """Read the parameters of an operation from the path, the query and the body of a request.

    Parameters in `in_path` are not read from the query, even if the path leaves them out.

    Raises:
        Malformed: one is missing or invalid, or the query has one that the operation does not have.
        ProblemError: 415, the body is not JSON.
    """
    known = parameters_of(kind)
    in_query = [each.name for each in known if not each.is_in_body and each.name not in in_path]
    if in_query and (unknown := sorted(set(request.query) - set(in_query))):
        *others, last = in_query
        only = f"are only {', '.join(others)} and {last}" if others else f"is only {last}"
        raise Malformed(f"{unknown[0]}: there {only}")
    given: dict[str, Any] = {name: request.query[name] for name in in_query if name in request.query}
    in_body = [each.name for each in known if each.is_in_body]
    if in_body:
        given |= await _body(request, in_body)
    return read_parameters(kind, given | request.match_info, is_text=True)


async def _body(request: web.Request, names: list[str]) -> dict[str, Any]:
    if request.content_type != "application/json":
        raise ProblemError(415, "the body must be application/json")
    try:
        body = json.loads(await request.read(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise Malformed("the body is not JSON") from None
    if not isinstance(body, dict) or not set(body) <= set(names):
        members = ", ".join(f'"{name}": ...' for name in names)
        raise Malformed(f"the body must be {{{members}}}")
    return body


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(name)


def unit_in(request: web.Request, operator: Operator) -> UnitPicture:
    """Describe the unit that the path of a request names, by its number or its name.

    Raises:
        WrongQuestion: there is none.
    """
    return picture(operator, read_parameters(OneUnit, request.match_info, is_text=True).unit)
