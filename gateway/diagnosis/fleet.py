"""Rules about the other sites of a fleet."""

from collections.abc import Iterator
from dataclasses import dataclass

from gateway.diagnosis.finding import Finding
from gateway.diagnosis.last import NOW, Last


@dataclass(frozen=True, slots=True)
class FleetEvidence:
    """The NATS server in use. `reason` says why there is no connection, `unseen` why others do not see this site.

    `dropped` requests came with a subject that NATS should not have let through.
    """

    server: str
    source: str
    reason: str
    unseen: str
    dropped: int
    last_dropped: Last = NOW


def about_fleet(fleet: FleetEvidence) -> Iterator[Finding]:
    """A server that is not reached or refuses, and permissions that are too wide."""
    about, place = f"fleet {fleet.server}", f"see [fleet] in {fleet.source}"
    if fleet.reason:
        yield Finding("fix", about, f"no other site can be reached: {fleet.reason}", place)
        return
    yield Finding("ok", about, "is connected")
    if fleet.unseen:
        yield Finding("note", about, f"status --fleet does not show this site: {fleet.unseen}", place)
    if fleet.dropped:
        counted = f"{fleet.dropped} requests came under the name of another site, or for its answers"
        what = f"{counted}{fleet.last_dropped}; none was carried out"
        yield Finding(
            fleet.last_dropped.level, about, what, "give each site the permissions of docs/fleet.md, and no others"
        )
