"""A request on its way through the gateway: its caller, its origin and its target."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol

from gateway.compiler import mypyc_attr
from gateway.errors import RequestError
from gateway.modbus.pdu import exception_response


@dataclass(frozen=True, slots=True)
class Caller:
    """The client that requests come from, as rights, turns, events and the trace know it."""

    #: Its name in events: `10.2.0.7:49152`.
    client: str
    #: Its address, on which its rights depend: `10.2.0.7`; empty if it has none.
    host: str
    #: Callers with the same key take turns as one: its address, see `listeners.share_keys`; its name if it has none.
    share_key: str
    #: Who it is by its certificate, or by what another site tells of it; both are empty for others.
    subject: str = ""
    role: str = ""
    #: Whether its request takes one of the first turns, by the priority of the row that allows it.
    has_priority: bool = False

    @classmethod
    def without_address(cls, name: str) -> "Caller":
        """Make the caller of a part of the gateway, or of a client on a serial line."""
        return cls(name, "", name)

    def with_priority(self) -> "Caller":
        """Make the same caller, for a request that takes one of the first turns."""
        return replace(self, has_priority=True)


@mypyc_attr(allow_interpreted_subclasses=True)
class Origin:
    """Where a request comes from and its response goes: a client's session. `caller` is the client."""

    __slots__ = ()

    caller: Caller

    @abstractmethod
    def wants(self, request: "Request") -> bool:
        """Tell whether a waiting request should still be sent: not for a client that has disconnected."""

    @abstractmethod
    def answer(self, request: "Request", pdu: bytes | None) -> None:
        """Take the one response to `request`; None ends it without one. Never raises."""


class Place(Protocol):
    """Where a request waits; for one that was passed on, where the requests derived from it wait."""

    def give_up(self) -> None:
        """See Request."""


@mypyc_attr(free_list_len=1)
class Request:
    """A request PDU for a unit, with the way back to its client.

    Exactly one of `respond`, `fail` and `end` is called, once, perhaps before `submit` returns; none raises. `error` is
    what it failed with; `is_over` is true from then on.
    """

    __slots__ = (
        "caller", "device", "error", "in_one_turn", "is_over", "origin", "pdu", "place", "received_at", "transaction",
        "unit",
    )  # fmt: skip

    def __init__(self, unit: int, pdu: bytes, origin: Origin, received_at: float, transaction: int = 0) -> None:
        """`unit` is the client's number for it; `transaction` is for the origin."""
        self.unit = unit
        self.pdu = pdu
        self.origin = origin
        self.caller = origin.caller
        self.received_at = received_at
        self.transaction = transaction
        self.error: RequestError | None = None
        self.is_over = False
        #: With function 22, for a write of the gateway itself to some bits of a register: the function, 06 or 16, that
        #: writes the register after it was read, in one turn, if the device's profile does not name 22. Else 0.
        self.in_one_turn = 0
        #: The name of the device to which a virtual unit has passed it on; empty for all others.
        self.device = ""
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
        """Note that its origin may not want it any more: it is asked before others are refused for lack of room."""
        if self.place is not None:
            self.place.give_up()

    def __repr__(self) -> str:
        return f"<Request unit={self.unit} {self.pdu.hex(' ').upper()} from {self.caller.client}>"


class DerivedOrigin(Origin):
    """The Origin of requests derived from a client's request: the same caller. `answer` is up to subclasses."""

    def __init__(self, original: Request) -> None:
        self.original = original
        self.caller = original.caller

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - wanted as long as the original is
        """See Origin."""
        return self.original.origin.wants(self.original)


@mypyc_attr(allow_interpreted_subclasses=True)
class Target:
    """A target of requests: a local image, a device on a line, a broadcast."""

    __slots__ = ()

    @abstractmethod
    def submit(self, request: Request, now: float) -> None:
        """Take over `request`, which arrived at `now`, and finish it."""


@mypyc_attr(allow_interpreted_subclasses=True)
class NamedTarget(Target):
    """One with a `name`, for the trace; empty for that of all units together."""

    __slots__ = ()

    name: str
