"""Metrics of requests from other sites."""

from collections.abc import Iterator

from gateway.fleet.status import FleetStatus
from gateway.observe.families import Family


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
