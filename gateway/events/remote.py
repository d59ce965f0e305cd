"""The broker, the other sites with the leases of lines, and the web page with its users."""

from gateway.events.event import Event, Level


class BrokerUp(Event):
    """Values are published there, with this version of MQTT."""

    says = "values are published at {broker}, with MQTT {version}"
    ends = ("broker {broker}",)
    broker: str
    version: str


class BrokerLost(Event):
    """Nothing is published: the broker cannot be reached, or refuses. The gateway tries again."""

    level = Level.WARNING
    says = "nothing is published at {broker}: {reason}"
    begins = "broker {broker}"
    broker: str
    reason: str


class BrokerRefused(Event):
    """The broker does not publish what it is sent; logged once for each connection."""

    level = Level.WARNING
    says = "{broker} refuses what it is sent: {reason}"
    broker: str
    reason: str


class ValuesGivenUp(Event):
    """Values that were kept for the broker will never be sent: so many since this was told, at most once a minute."""

    level = Level.WARNING
    says = "{values} values that were kept for the broker were given up: {reason}"
    values: int
    reason: str


class KeptValuesSent(Event):
    """All values that were kept while the broker was away were sent: the first time in a connection."""

    says = "{values} values that were kept for the broker were sent in {seconds} s"
    values: int
    seconds: float


class CommandRefused(Event):
    """Somebody wants to write what the broker's `topic` names, but there is no such point, or it must not be written.

    `client` is `mqtt`.
    """

    level = Level.WARNING
    says = "a value for the topic {topic} was refused: {reason}"
    client: str
    topic: str
    reason: str


class FleetUp(Event):
    """The gateway is connected to this NATS server, and other sites can reach it."""

    says = "other sites can be reached through {server}"
    ends = ("fleet {server}",)
    server: str


class FleetLost(Event):
    """NATS cannot be reached, or refuses: no other site can be reached. The gateway tries again; all else works."""

    level = Level.WARNING
    says = "no other site can be reached through {server}: {reason}"
    begins = "fleet {server}"
    server: str
    reason: str


class FleetRefused(Event):
    """NATS refuses a subject to this site; logged once for each connection."""

    level = Level.WARNING
    says = "{server} refuses a subject: {reason}"
    server: str
    reason: str


class FleetBucketUnsafe(Event):
    """A bucket of NATS has settings by which a site can harm others; logged once for each connection."""

    level = Level.WARNING
    says = "a bucket of {server} is not safe: {reason}"
    server: str
    reason: str


class LeaseTaken(Event):
    """This gateway holds the lease of a line: it opens the port, and sends requests after this silence."""

    says = "this gateway holds the lease {lease} of line {line}[, and sends requests after {silent_s} s]"
    line: str
    lease: str
    silent_s: float


class LeaseLost(Event):
    """This gateway does not hold the lease of a line any more: it has closed the port, and sends nothing."""

    level = Level.WARNING
    says = "this gateway does not hold the lease {lease} of line {line} any more: {reason}"
    line: str
    lease: str
    reason: str


class WebUp(Event):
    """The web page, the API and metrics can be reached over HTTP."""

    says = "the web page is at {address}"
    address: str


class WebClosed(Event):
    """Nothing can be reached over HTTP. All else works."""

    level = Level.WARNING
    says = "there is no web page at {address}: {reason}"
    begins = "web"
    address: str
    reason: str


class WebLogin(Event):
    """Somebody has logged in at the web page, or a program begins to use its token."""

    says = "{user} has logged in from {client}"
    client: str
    user: str


class WebLoginFailed(Event):
    """Somebody has sent a wrong password, or token, to the web page; `user` is empty if there is no such user."""

    level = Level.WARNING
    says = "a wrong password or token was sent[ for {user}] from {client}"
    client: str
    user: str


class WebDenied(Event):
    """A user or a program has asked the web page for something that its role does not allow. Nothing was done."""

    level = Level.WARNING
    says = "{client} is a {role}, and may not {method} {path}"
    client: str
    role: str
    method: str
    path: str


class WebUsersRejected(Event):
    """The file with the users cannot be used as it is now; those that were in it before stay."""

    level = Level.WARNING
    says = "the file with the users cannot be used: {reason}"
    reason: str
