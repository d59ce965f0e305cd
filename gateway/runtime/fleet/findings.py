"""What `doctor` says about other sites and NATS servers."""

from collections.abc import Iterator
from typing import Final

from gateway.diagnosis.finding import IS_DOWN, Finding
from gateway.diagnosis.last import Last
from gateway.fleet.status import FleetStatus

#: The first nats-server that no site can end by a reply subject with a wildcard (nats-io/nats-server#3862).
SAFE: Final = (2, 9, 15)


def findings_about(fleet: FleetStatus | None) -> Iterator[Finding]:
    """Find a server that is not reached or refuses, and permissions that are too wide; nothing without [fleet]."""
    if fleet is None:
        return
    about, place = f"fleet {fleet.server}", f"see [fleet] in {fleet.source}"
    if fleet.reason:
        yield Finding("fix", about, f"no other site can be reached: {fleet.reason}", place)
        return
    yield Finding("ok", about, "is connected")
    if _is_old(fleet.server_version):
        what = f"with version {fleet.server_version}, any site can end the server of a hub"
        yield Finding("note", about, what, "install a newer nats-server there: docs/fleet.md, The hub")
    if fleet.unseen:
        yield Finding("note", about, f"status --fleet does not show this site: {fleet.unseen}", place)
    if fleet.dropped:
        last = Last((fleet.last_dropped_ms or 0.0) / 1000)
        counted = f"{fleet.dropped} requests came under the name of another site, or for its answers"
        what = f"{counted}{last}; none was carried out"
        yield Finding(last.level, about, what, "give each site the permissions of docs/fleet.md, and no others")


def _is_old(version: str) -> bool:
    """Tell whether a server is older than SAFE; False if it does not say so."""
    parts = version.split(".")
    return all(part.isdecimal() and len(part) < 5 for part in parts) and tuple(map(int, parts)) < SAFE


def findings_about_upstream(fleet: FleetStatus | None, name: str, site: str, error: object) -> Iterator[Finding]:
    """Say why the `site` of the upstream `name` is not reached, unless the finding about NATS says it."""
    if fleet is None or not fleet.reason:
        remedy = f"check the gateway of {site}, and its connection to NATS: modbus-gateway status --fleet"
        yield Finding("fix", name, f"{IS_DOWN}{error}", remedy)
