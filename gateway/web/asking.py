"""Units are asked for whoever has sent an HTTP request, as long as he waits."""

from functools import partial

from aiohttp import web

from gateway.web.answers import Answers, Asker, Unit
from gateway.web.guard import VISITOR
from gateway.web.values import Ask


def ask_for(request: web.Request, answers: Answers, unit: Unit) -> Ask:
    """What sends request PDUs to a unit, with the rights of the visitor."""
    visitor = request[VISITOR]
    asker = Asker(visitor.client, visitor.host, partial(is_there, request))
    return lambda pdu: answers.ask(unit.unit, pdu, asker)


def is_there(request: web.Request) -> bool:
    """Whether who has asked still waits."""
    return request.transport is not None and not request.transport.is_closing()
