"""The status of the connection to other sites, and of the sites."""

from dataclasses import dataclass
from typing import Literal

from gateway.fleet.inventory import SiteInventory


@dataclass(frozen=True, slots=True)
class FleetStatus:
    """The connection to NATS. `reason` is why there is none, `unseen` why others do not see this site.

    It has been down for `down_ms`, None if it is up; and up for `up_ms`, None if it is down. `requests` from other
    sites were received and `responses` sent; `busy` ones were rejected because too many were in progress, `expired`
    ones because their deadline had passed, `refused` ones because they name no instance of this gateway or have passed
    too many sites. `dropped` ones came with a subject that NATS should have rejected, the last one `last_dropped_ms`
    ago. `unreadable` messages and those that `overflowed` a queue were not delivered. The server has told its
    `server_version`; empty while there is no connection.
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
    up_ms: float | None = None
    server_version: str = ""


@dataclass(frozen=True, slots=True)
class SiteStatus:
    """The status of a site, as published by itself. Times are in seconds.

    It is `up`, has `left`, or is `lost` because it has not renewed its entry. It is `silent` if this site uses its
    units and does not hear it. It has been in this state for `for_s`, and `started` is when it last began to serve.
    Of an entry that `cannot be read` only the site and the age are known.
    `lines` is the number of lines that are up; `lines_down` names those that are down, and other servers and sites that
    it cannot reach. It serves `units` units. Old versions tell no `inventory`.
    """

    site: str
    state: Literal["up", "silent", "left", "lost", "cannot be read"]
    for_s: float
    started: str
    host: str
    version: str
    lines: int
    lines_down: tuple[str, ...]
    units: int
    inventory: SiteInventory | None = None
