"""The broker, the other sites with the leases of lines, and the web page with its users."""

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


class FleetUp(Event):
    """The gateway is connected to this NATS server, and other sites can reach it."""

    server: str


class FleetLost(Event):
    """NATS cannot be reached, or refuses: no other site can be reached. The gateway tries again; all else works."""

    level = Level.WARNING
    server: str
    reason: str


class FleetRefused(Event):
    """NATS refuses a subject to this site; logged once for each connection."""

    level = Level.WARNING
    server: str
    reason: str


class FleetBucketUnsafe(Event):
    """A bucket of NATS has settings by which a site can harm others; logged once for each connection."""

    level = Level.WARNING
    server: str
    reason: str


class LeaseTaken(Event):
    """This gateway holds the lease of a line: it opens the port, and sends requests after this silence."""

    line: str
    lease: str
    silent_s: float


class LeaseLost(Event):
    """This gateway does not hold the lease of a line any more: it has closed the port, and sends nothing."""

    level = Level.WARNING
    line: str
    lease: str
    reason: str


class WebUp(Event):
    """The web page, the API and metrics can be reached over HTTP."""

    address: str


class WebClosed(Event):
    """Nothing can be reached over HTTP. All else works."""

    level = Level.WARNING
    address: str
    reason: str


class WebLogin(Event):
    """Somebody has logged in at the web page."""

    client: str
    user: str


class WebLoginFailed(Event):
    """Somebody has sent a wrong password to the web page; `user` is empty if there is no such user."""

    level = Level.WARNING
    client: str
    user: str


class WebUsersRejected(Event):
    """The file with the users cannot be used as it is now; those that were in it before stay."""

    level = Level.WARNING
    reason: str
