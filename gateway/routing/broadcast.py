"""Requests to unit 0: each is sent once to every line and image, without a response."""

from collections.abc import Collection
from typing import NamedTuple

from gateway.errors import IllegalFunction, RequestError
from gateway.modbus.codes import BROADCAST_UNIT
from gateway.modbus.functions import BROADCAST_FUNCTIONS
from gateway.modbus.pdu import parse_request
from gateway.request import DerivedOrigin, NamedTarget, Request, Target
from gateway.trace.ring import Ring


class Recipient(NamedTuple):
    """A target of broadcasts, and the functions it accepts: a Mint controller only accepts 05 and 16."""

    target: Target
    functions: frozenset[int] = BROADCAST_FUNCTIONS


class Broadcast(NamedTarget):
    """A Target that copies a write to all recipients that accept its function; it ends when all copies have."""

    name = ""

    def __init__(self, recipients: Collection[Recipient], ring: Ring | None = None) -> None:
        self._recipients = recipients
        self._ring = ring or Ring()

    def submit(self, request: Request, now: float) -> None:
        """Copy a write to all recipients; reject any other function with 01, a malformed request with 03."""
        try:
            if request.pdu[0] not in BROADCAST_FUNCTIONS:
                raise IllegalFunction(f"function {request.pdu[0]} cannot be broadcast")
            if request.in_one_turn:
                raise IllegalFunction("bits cannot be written to all devices: their registers cannot be read")
            parse_request(request.pdu)
        except RequestError as error:
            self._ring.refuse(request, error, now)
            request.fail(error)
            return
        targets = [target for target, functions in self._recipients if request.pdu[0] in functions]
        request.place = copies = _Copies(request, len(targets))
        for target in targets:
            target.submit(copies.another(now), now)
        copies.one_done()


class _Copies(DerivedOrigin):
    """The origin of a broadcast's copies, and its place while it waits: it ends after all of them."""

    def __init__(self, original: Request, count: int) -> None:
        super().__init__(original)
        self._open = count + 1
        self._copies: list[Request] = []

    def another(self, now: float) -> Request:
        copy = Request(BROADCAST_UNIT, self.original.pdu, self, now)
        self._copies.append(copy)
        return copy

    def give_up(self) -> None:
        for copy in self._copies:
            copy.give_up()

    def answer(self, request: Request, pdu: bytes | None) -> None:  # noqa: ARG002 - a broadcast has no response
        self.one_done()

    def one_done(self) -> None:
        self._open -= 1
        if self._open == 0:
            self._copies.clear()
            self.original.place = None
            self.original.end()
