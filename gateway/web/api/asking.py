"""Requests to units for a visitor who has sent an HTTP request, as long as the visitor waits."""

from functools import partial

from aiohttp import web

from gateway.web.access.guard import VISITOR
from gateway.web.api.answers import Answer, Answers, Unit, WebClient
from gateway.web.api.values import Ask
from gateway.web.front.problems import ProblemError


def ask_for(request: web.Request, answers: Answers, unit: Unit) -> Ask:
    """What sends request PDUs to a unit, with the rights of the visitor; see `ask_as`."""
    visitor = request[VISITOR]
    return ask_as(WebClient(visitor.caller, partial(is_there, request)), answers, unit)


def ask_as(client: WebClient, answers: Answers, unit: Unit) -> Ask:
    """What sends request PDUs to a unit until a reload leads its number elsewhere; then it raises ProblemError.

    To be called as soon as the unit is known, before anything is waited for.
    """
    target = answers.target(unit.unit)

    async def ask(pdu: bytes) -> Answer:
        if answers.target(unit.unit) is not target:
            raise ProblemError(409, f"unit {unit.unit} has changed by a reload: ask again")
        return await answers.ask(unit.unit, pdu, client)

    return ask


def is_there(request: web.Request) -> bool:
    """Whether who has asked still waits."""
    return request.transport is not None and not request.transport.is_closing()
