"""The broker."""

from gateway.events.event import Event, Level


class BrokerUp(Event):
    """Values are published there, with this version of MQTT."""

    broker: str
    version: str


class BrokerLost(Event):
    """Nothing is published: the broker cannot be reached, or refuses. The gateway tries again."""

    level = Level.WARNING
    broker: str
    reason: str


class BrokerRefused(Event):
    """The broker does not publish what it is sent; logged once for each connection."""

    level = Level.WARNING
    broker: str
    reason: str


class CommandRefused(Event):
    """Somebody wants to write what the broker's `topic` names, but there is no such point, or it must not be written.

    `client` is `mqtt`.
    """

    level = Level.WARNING
    client: str
    topic: str
    reason: str
