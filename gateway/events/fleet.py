"""The other sites, and the leases of lines."""

from gateway.events.event import Event, Level


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
