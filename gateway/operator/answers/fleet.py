"""The other sites of a fleet."""

from dataclasses import dataclass

from gateway.fleet.status import SiteStatus


@dataclass(frozen=True, slots=True)
class Sites:
    """The sites of a fleet, by name."""

    sites: tuple[SiteStatus, ...]
