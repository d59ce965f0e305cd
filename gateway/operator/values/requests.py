"""Requests of operations to units, with the rights, the queue and the limits of any client."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Final, NamedTuple

from gateway.config.values.reserved_names import CONTROL
from gateway.errors import ChangedMeanwhile, LineDown, Malformed, RequestError
from gateway.modbus.codes import HIGHEST_UNIT, MAX_PDU, FunctionCode
from gateway.modbus.functions import only_reads
from gateway.modbus.pdu import exception_response
from gateway.operator.operations.answers.unit import RequestAnswer
from gateway.operator.operations.asked import OneRequest
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.reached import target
from gateway.operator.units.units import find_unit, shown_unit
from gateway.operator.values.frames import frames_of
from gateway.operator.values.steps import Answer, Step
from gateway.ports.port import SiteSettings
from gateway.request import Caller, Origin, Request
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway

#: The caller of all requests from the control socket.
AT_CONTROL: Final = Caller.without_address(CONTROL)


class AwaitedOrigin(Origin):
    """The Origin of one request of an operator. `outcome` is its error, if any, and its response."""

    def __init__(self, is_there: Callable[[], bool], caller: Caller = AT_CONTROL) -> None:
        """Make the origin of one request; `is_there` returns whether the operator is still connected."""
        self.caller = caller
        self.outcome: asyncio.Future[tuple[RequestError | None, bytes | None]] = (
            asyncio.get_running_loop().create_future()
        )
        self._is_there = is_there

    def wants(self, request: Request) -> bool:
        """Return whether the request should still be sent: a write only while the operator is connected."""
        return not self.outcome.done() and (only_reads(request.pdu) or self._is_there())

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response."""
        if not self.outcome.done():
            self.outcome.set_result((request.error, pdu))


class Done(NamedTuple):
    """The outcome of a request: its response, its start, how long it took, and the gateway's error, if any."""

    pdu: bytes | None
    started: float
    elapsed_ms: float
    error: RequestError | None


#: Sends a request to a unit, and returns the answer.
Ask = Callable[[Step], Awaitable[Answer]]


def ask_for(operator: Operator, unit: int, asker: Asker, make_origin: Callable[[], AwaitedOrigin] | None = None) -> Ask:
    """Make a function that sends requests to a unit with the asker's rights, while its target stays the same.

    After a reload that changed the target it raises ChangedMeanwhile. Call this as soon as the unit is known, before
    any wait. `make_origin` makes the origin of each request; by default it only awaits its outcome.
    """
    make_origin = make_origin or partial(AwaitedOrigin, asker.is_there, asker.caller)
    gateway = operator.gateway
    expected = target(gateway, unit)
    called = f"unit {unit}" if unit <= HIGHEST_UNIT else "the device"

    async def ask(step: Step) -> Answer:
        if asker.door == "control":
            await operator.running.settled()
        if operator.gateway is not gateway and target(operator.gateway, unit) is not expected:
            raise ChangedMeanwhile(f"{called} has changed by a reload: ask again")
        done = await send(operator.router(asker.door), unit, step, make_origin())
        response = exception_response(step.pdu[0], 0) if done.pdu is None else done.pdu
        if done.error is None:
            return Answer(response, done.elapsed_ms)
        return Answer(response, done.elapsed_ms, done.error.result, str(done.error))

    return ask


async def ask(operator: Operator, asked: OneRequest, asker: Asker) -> RequestAnswer:
    """Send a request as any client does, with rights, queue and limits.

    Raises:
        WrongQuestion: there is no such unit.
        Malformed: `pdu` is not a PDU, or none that can be carried out in one turn.
    """
    running = operator.running
    await running.settled()
    gateway = running.gateway
    unit, pdu = find_unit(gateway.plan, asked.unit), _pdu(asked.pdu)
    if asked.in_one_turn and pdu[0] != FunctionCode.MASK_WRITE_REGISTER:
        raise Malformed('"in_one_turn" is for function 22 only')
    step = Step(pdu, asked.in_one_turn)
    done = await send(operator.router(asker.door), unit, step, AwaitedOrigin(asker.is_there, asker.caller))
    result, reason = "", ""
    if done.error is not None:
        result = done.error.result
        reason = _missing_site(gateway, unit) if isinstance(done.error, LineDown) else str(done.error)
    return RequestAnswer(
        unit=shown_unit(unit),
        pdu=None if done.pdu is None else done.pdu.hex(" ").upper(),
        elapsed_ms=done.elapsed_ms,
        result=result,
        reason=reason,
        **frames_of(running, asker.caller.client, None if asked.in_one_turn else pdu, done.started),
    )


def _missing_site(gateway: Gateway, unit: int) -> str:
    """Say why the site of a unit cannot be reached; empty if it can, or if the unit is of this site."""
    for upstream in gateway.upstreams:
        trouble = upstream.reconnector.error
        if unit in upstream.devices and trouble is not None and isinstance(upstream.plan.port, SiteSettings):
            return f"{trouble}; modbus-gateway status --fleet shows the sites"
    return ""


async def send(router: Router, unit: int, step: Step, question: AwaitedOrigin) -> Done:
    """Send a request through `router`, and wait for its outcome; it is dropped if this is cancelled while it waits.

    Others get their turns, though an image answers at once.
    """
    now = asyncio.get_running_loop().time
    started = now()
    request = Request(unit, step.pdu, question, started)
    request.in_one_turn = step.in_one_turn
    router.submit(request, started)
    try:
        if question.outcome.done():
            await asyncio.sleep(0)
        error, response = await question.outcome
    except asyncio.CancelledError:
        request.give_up()
        raise
    return Done(response, started, round((now() - started) * 1000, 1), error)


def _pdu(text: str) -> bytes:
    try:
        pdu = bytes.fromhex(text)
    except ValueError:
        pdu = b""
    if not 1 <= len(pdu) <= MAX_PDU:
        raise Malformed(f'"pdu" must be 1 to {MAX_PDU} bytes in hexadecimal, such as "03 00 00 00 02"')
    return pdu
