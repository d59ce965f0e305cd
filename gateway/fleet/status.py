"""The connection to other sites, and the sites, for the status."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class FleetStatus:
    """The connection to NATS. `reason` says why there is none, `unseen` why others do not see this site.

    It has been down for `down_ms`; None if it is up. Of `requests` from other sites, so many got `responses`; `busy`
    ones were too many at once, `expired` ones too late to be sent, `refused` ones for no gateway, or in a circle.
    `dropped` ones came with a subject that NATS should not have let through, the last one `last_dropped_ms` ago. Of
    messages, so many were `unreadable`, or `overflowed` a queue: these were not delivered.
    """

    server: str
    source: str
    site: str
    state: Literal["up", "down"]
    reason: str
    unseen: str
    down_ms: float | None
    attempts: int
    requests: int
    responses: int
    busy: int
    expired: int
    refused: int
    dropped: int
    unreadable: int
    overflowed: int
    last_dropped_ms: float | None = None


@dataclass(frozen=True, slots=True)
class SiteStatus:
    """A site, as it said itself. Times are in seconds.

    It is `up`, has `left`, or is `lost`: it has not renewed its entry. It is `silent` if this site asks its units and
    does not hear it. That has been so `for_s` seconds. So many `lines` are up; `lines_down` are the names of those that
    are not, and of other servers and sites that are not reached. It serves so many `units`.
    """

    site: str
    state: Literal["up", "silent", "left", "lost"]
    for_s: float
    host: str
    version: str
    lines: int
    lines_down: tuple[str, ...]
    units: int
