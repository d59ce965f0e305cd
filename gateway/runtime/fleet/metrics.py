"""Metrics of requests from other sites, and of the sites that this one asks."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Final

from gateway.fleet.status import FleetStatus, SiteStatus
from gateway.observe.families import Family

_STATES: Final = ("up", "silent", "left", "lost", "cannot be read")


def metrics_of(fleet: FleetStatus | None) -> Iterator[Family]:
    """Count requests from other sites, and lost messages; nothing without [fleet]."""
    if fleet is None:
        return
    up = Family("gauge", "fleet_up", "Whether the gateway is connected to NATS, and other sites can reach it.")
    up.add(fleet.state == "up")
    requests = Family("counter", "fleet_requests", "Requests from other sites by what became of them.", ("result",))
    for result in ("responses", "busy", "expired", "refused", "dropped"):
        requests.add(getattr(fleet, result), {"responses": "ok"}.get(result, result))
    lost = Family("counter", "fleet_lost_messages", "Messages of other sites that were not delivered.", ("reason",))
    lost.add(fleet.unreadable, "unreadable")
    lost.add(fleet.overflowed, "overflowed")
    yield from (up, requests, lost)


def metrics_of_sites(sites: Sequence[SiteStatus]) -> Iterator[Family]:
    """Tell how many sites are in each state, and of each one what must be mended; nothing without sites."""
    if not sites:
        return
    states = Family("gauge", "fleet_sites", "Sites that this gateway asks, by state.", ("state",))
    for state in _STATES:
        states.add(sum(each.state == state for each in sites), state)
    info = Family("gauge", "fleet_site_info", "1, with version and config of a site.", ("site", "version", "config"))
    down = Family("gauge", "fleet_site_lines_down", "Lines and connections of a site that are down.", ("site",))
    to_fix = Family("gauge", "fleet_site_findings", "What doctor would have somebody mend at a site.", ("site",))
    ends = Family(
        "gauge",
        "fleet_site_certificate_expiry_timestamp_seconds",
        "Until when the first certificate of a site to expire is valid.",
        ("site",),
    )
    for each in sites:
        if not each.started:  # its entry cannot be read
            continue
        inventory = each.inventory
        info.add(1, each.site, each.version, "" if inventory is None else inventory.config)
        down.add(len(each.lines_down), each.site)
        if inventory is not None:
            to_fix.add(inventory.to_fix, each.site)
            for first in inventory.certificates[:1]:
                ends.add(datetime.fromisoformat(f"{first.until}T00:00:00Z").timestamp(), each.site)
    yield from (states, info, down, to_fix, *([ends] if ends.values else []))
