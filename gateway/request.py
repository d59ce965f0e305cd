"""One request on its way through the gateway, who asked it, and what can take it."""

from typing import Protocol

from gateway.errors import RequestError
from gateway.modbus.pdu import exception_response


class Origin(Protocol):
    """Where requests come from and their responses go: a client's session."""

    @property
    def client(self) -> str:
        """Who it is, for events: `10.2.0.7:49152`."""

    @property
    def host(self) -> str:
        """The address it asks from, `10.2.0.7`, on which its rights depend; empty when it has none."""

    def wants(self, request: "Request") -> bool:
        """Whether a request that still waits should be sent: not for a client that has left."""

    def answer(self, request: "Request", pdu: bytes | None) -> None:
        """Take the one response to `request`; None ends it without one. Never raises."""


class Request:
    """A request PDU for a unit, with the way back to its client.

    Exactly one of `respond`, `fail` and `end` is called, once, by whoever finishes the request. It may happen before
    `submit` returns, and it never raises. `error` is what it has failed with.
    """

    __slots__ = ("error", "origin", "pdu", "received_at", "transaction", "unit")

    def __init__(self, unit: int, pdu: bytes, origin: Origin, received_at: float, transaction: int = 0) -> None:
        """`unit` is the client's number for it; `transaction` is the origin's own mark for the response."""
        self.unit = unit
        self.pdu = pdu
        self.origin = origin
        self.received_at = received_at
        self.transaction = transaction
        self.error: RequestError | None = None

    def respond(self, pdu: bytes) -> None:
        """Answer with a response PDU."""
        self.origin.answer(self, pdu)

    def fail(self, error: RequestError) -> None:
        """Answer with the exception response that `error` stands for. The only place that makes one."""
        self.error = error
        self.origin.answer(self, exception_response(self.pdu[0], error.code))

    def end(self) -> None:
        """Finish without a response: nobody answers a broadcast, nor 08/04."""
        self.origin.answer(self, None)

    def __repr__(self) -> str:
        return f"<Request unit={self.unit} {self.pdu.hex(' ').upper()} from {self.origin.client}>"


class Target(Protocol):
    """What can take a request: a local image, a device on a line, a broadcast."""

    def submit(self, request: Request, now: float) -> None:
        """Take over `request`, which arrived at `now`, and finish it sooner or later."""
