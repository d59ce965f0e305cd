"""Clients and their connections."""

from gateway.events.event import Event, Level


class ClientEvent(Event):
    """An event about a client. One with a certificate has its `subject`, and its `role`, empty for the null role."""

    def fields(self) -> dict[str, object]:
        """The fields of the log line; these two only with a certificate."""
        found = super().fields()
        if not found["subject"]:
            del found["subject"], found["role"]
        return found


class ListenerUp(Event):
    """Clients can connect to this address."""

    listener: str
    address: str


class ClientConnected(ClientEvent):
    """A client has connected."""

    level = Level.DEBUG
    listener: str
    client: str
    subject: str = ""
    role: str = ""


class ClientClosed(Event):
    """A client's connection has ended."""

    level = Level.DEBUG
    listener: str
    client: str
    reason: str


class ClientRejected(Event):
    """A connection was closed because of what the client did, its missing rights, or because the listener was full."""

    level = Level.WARNING
    listener: str
    client: str
    reason: str


class AnswerWithheld(Event):
    """The client on a server line got no response: it would have taken it for the response to another request."""

    level = Level.WARNING
    line: str
    unit: int
    function: int
    elapsed_ms: float
    reason: str
    source: str
