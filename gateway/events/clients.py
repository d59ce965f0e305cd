"""Clients: their connections, what they may not do, and what they wrote."""

from typing import Final, Self

from gateway import errors
from gateway.errors import RequestError
from gateway.events.event import Event, Level
from gateway.request import Request


class ClientEvent(Event):
    """An event about a client. One with a certificate has its `subject`, and its `role`, empty for the null role.

    `device` is the name of a device without a unit for clients, and `unit` the one on the wire; or that of the device
    to which a write to a virtual unit went.
    """

    def fields(self) -> dict[str, object]:
        """Return the fields of the log line; the first two only with a certificate."""
        found = super().fields()
        if not found["subject"]:
            del found["subject"], found["role"]
        for name in ("device", "refused_at"):
            if not found.get(name):
                found.pop(name, None)
        return found


class ListenerUp(Event):
    """Clients can connect to this address."""

    says = "clients can connect to {address}"
    listener: str
    address: str


class ClientConnected(ClientEvent):
    """A client has connected."""

    level = Level.DEBUG
    says = "{client} has connected to {listener}[ as {subject}]"
    listener: str
    client: str
    subject: str = ""
    role: str = ""


class ClientClosed(Event):
    """A client's connection has ended."""

    level = Level.DEBUG
    says = "{client} has left {listener}: {reason}"
    listener: str
    client: str
    reason: str


class ClientRejected(Event):
    """A connection was closed because of what the client did, its missing rights, or because the listener was full."""

    level = Level.WARNING
    says = "{listener} has closed the connection of {client}: {reason}"
    listener: str
    client: str
    reason: str


class AnswerWithheld(Event):
    """The client on a server line got no response: it would have taken it for the response to another request."""

    level = Level.WARNING
    says = "line {line}: no response was sent to the client, after {elapsed_ms} ms: {reason}"
    line: str
    unit: int
    function: int
    elapsed_ms: float
    reason: str
    source: str


class RequestRefused(Event):
    """A client requested something that `unit` does not have: exception `code`, and nothing was sent.

    If there is no such unit, `listener` tells where it is missing; else `device` is its name.
    """

    says = "{client} asked[ {device},] unit {unit} with function {function}, and got {code}[: {why}]"
    client: str
    unit: int
    function: int
    code: str
    why: str
    listener: str = ""
    device: str = ""

    @classmethod
    def of(cls, request: Request, error: RequestError, *, listener: str = "", device: str = "") -> Self:
        """Make the rejection of `request` with `error`."""
        code = f"{error.code:02X}"
        return cls(request.caller.client, request.unit, request.pdu[0], code, str(error), listener, device)


class AccessDenied(ClientEvent):
    """A client used a function without the right to it; it got exception 01, and nothing was sent.

    `refused_at` is an address that is refused, such as `holding 99`; empty if the request tells none.
    """

    level = Level.WARNING
    says = (
        "{client} has no right to function {function} of[ {device},] unit {unit}"
        "[ at {refused_at}][, with the role {role}]"
    )
    listener: str
    client: str
    unit: int
    function: int
    subject: str = ""
    role: str = ""
    device: str = ""
    refused_at: str = ""


class WriteAudit(ClientEvent):
    """The result of a request that may have changed something: one event for each such request.

    `address` and `count` are the coils or registers to write; None for functions without them, and for malformed
    requests. `result` is `ok` (also for 08/04, which has no response), `exception` (from the unit), `broadcast` (no
    response), `unwanted` (the client disconnected before it was sent), or why the gateway rejected it or got no
    response, as in the counts of a unit. `code` is the exception, if any.
    """

    says = (
        "{client} wrote to[ {device},] unit {unit}[, address {address}]"
        "[, count {count}] with function {function}: {result}[ {code}]"
    )
    client: str
    listener: str
    unit: int
    function: int
    address: int | None
    count: int | None
    result: str
    code: str
    elapsed_ms: float
    subject: str = ""
    role: str = ""
    device: str = ""

    @property
    def was_sent(self) -> bool:
        """Whether the request was sent, so that the write may have been carried out."""
        return self.result in _SENT


#: Results of writes that went to their units.
_SENT: Final = frozenset(
    {
        *("ok", "exception", "broadcast"),
        errors.ResponseTimeout.result,
        errors.BrokenResponse.result,
        errors.AmbiguousResponse.result,
        errors.LineLost.result,
    }
)
