"""Counts of a listener's clients: connected, rejected, or left before their response."""

from dataclasses import dataclass, field
from typing import Final, TypeVar

from gateway.timing.measured import NEVER

#: The most addresses of each kind; the one without news for the longest time goes first.
MOST_HOSTS: Final = 64

Entry = TypeVar("Entry")


@dataclass(slots=True)
class Rejection:
    """Number of rejections of clients at one address, the last time in seconds of the loop's clock, and its reason."""

    count: int = 0
    at: float = NEVER
    reason: str = ""


@dataclass(slots=True)
class Departure:
    """Number of clients at one address that left before their response: their time-out may be too short.

    The last one left at `at`, and had waited for `waited` seconds.
    """

    count: int = 0
    at: float = NEVER
    waited: float = 0.0


@dataclass(slots=True)
class ClientCounts:
    """Clients that have connected, and clients that were rejected, at once or later.

    `rejections` and `departures` are by the address of the client, the latest one last.
    """

    accepted: int = 0
    rejected: int = 0
    rejections: dict[str, Rejection] = field(default_factory=dict)
    departures: dict[str, Departure] = field(default_factory=dict)

    def add_rejection(self, host: str, reason: str, now: float) -> None:
        """Count a rejected client at `host`."""
        self.rejected += 1
        rejection = self.rejections.pop(host, None) or Rejection()
        rejection.count += 1
        rejection.at, rejection.reason = now, reason
        _keep(self.rejections, host, rejection)

    def add_departure(self, host: str, waited: float, now: float) -> None:
        """Count a client at `host` that has left `waited` seconds after its last request, without a response."""
        departure = self.departures.pop(host, None) or Departure()
        departure.count += 1
        departure.at, departure.waited = now, waited
        _keep(self.departures, host, departure)


def _keep(by_host: dict[str, Entry], host: str, entry: Entry) -> None:
    by_host[host] = entry
    if len(by_host) > MOST_HOSTS:
        del by_host[next(iter(by_host))]
