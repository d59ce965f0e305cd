"""A request on its way through the gateway, its origin, and its target."""

from typing import Protocol

from gateway.errors import RequestError
from gateway.modbus.pdu import exception_response


class Origin(Protocol):
    """Where a request comes from and its response goes: a client's session."""

    @property
    def client(self) -> str:
        """Its name in events: `10.2.0.7:49152`."""

    @property
    def host(self) -> str:
        """Its address, `10.2.0.7`, on which its rights depend; empty if it has none."""

    @property
    def share(self) -> str:
        """What has one share of a line: its address, see `listeners.origin`; its name if it has none.

        All of one name have the same.
        """

    def wants(self, request: "Request") -> bool:
        """Whether a waiting request should still be sent: not for a client that has disconnected."""

    def answer(self, request: "Request", pdu: bytes | None) -> None:
        """Take the one response to `request`; None ends it without one. Never raises."""


class Place(Protocol):
    """Where a request waits; of one that was passed on, where what was made of it waits."""

    def give_up(self) -> None:
        """See Request."""


class Request:
    """A request PDU for a unit, with the way back to its client.

    Exactly one of `respond`, `fail` and `end` is called, once, perhaps before `submit` returns; none raises. `error` is
    what it failed with; `is_over` is true from then on.
    """

    __slots__ = ("error", "is_over", "origin", "pdu", "place", "received_at", "transaction", "unit")

    def __init__(self, unit: int, pdu: bytes, origin: Origin, received_at: float, transaction: int = 0) -> None:
        """`unit` is the client's number for it; `transaction` is for the origin."""
        self.unit = unit
        self.pdu = pdu
        self.origin = origin
        self.received_at = received_at
        self.transaction = transaction
        self.error: RequestError | None = None
        self.is_over = False
        #: Where it waits, while it does.
        self.place: Place | None = None

    def respond(self, pdu: bytes) -> None:
        """Answer with a response PDU."""
        self.is_over = True
        self.origin.answer(self, pdu)

    def fail(self, error: RequestError) -> None:
        """Answer with the exception response that `error` stands for. The only place that makes one."""
        self.error = error
        self.is_over = True
        self.origin.answer(self, exception_response(self.pdu[0], error.code))

    def end(self) -> None:
        """Finish without a response: a broadcast, or 08/04."""
        self.is_over = True
        self.origin.answer(self, None)

    def give_up(self) -> None:
        """Perhaps its origin does not want it any more. It is asked before others are refused for it."""
        if self.place is not None:
            self.place.give_up()

    def __repr__(self) -> str:
        return f"<Request unit={self.unit} {self.pdu.hex(' ').upper()} from {self.origin.client}>"


class DerivedOrigin:
    """The Origin of requests that are made of a client's, as far as the client counts; `answer` is up to subclasses."""

    def __init__(self, original: Request) -> None:
        self.original = original
        self.client = original.origin.client
        self.host = original.origin.host
        self.share = original.origin.share

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - they are wanted as long as the original is
        """See Origin."""
        return self.original.origin.wants(self.original)


class Target(Protocol):
    """A target of requests: a local image, a device on a line, a broadcast."""

    def submit(self, request: Request, now: float) -> None:
        """Take over `request`, which arrived at `now`, and finish it."""


class NamedTarget(Target, Protocol):
    """One with a name, for the trace; empty for that of all units together."""

    @property
    def name(self) -> str:
        """What it is called."""
