"""Counts clients that close their connection before their response: their time-out may be too short."""

from dataclasses import dataclass
from typing import Final

from gateway.timing.measured import NEVER

#: At most this many addresses are kept; the one that did this the longest time ago is forgotten first.
MOST_HOSTS: Final = 64


@dataclass(slots=True)
class Departure:
    """How often clients at one address did that, and how many seconds the last one had waited, which left at `at`."""

    count: int = 0
    waited: float = 0.0
    at: float = NEVER


class Departures:
    """Those of one listener, by the address of the client."""

    def __init__(self) -> None:
        self.by_host: dict[str, Departure] = {}

    def add(self, host: str, waited: float, now: float) -> None:
        """A client at `host` closed its connection `waited` seconds after its last request, without a response."""
        departure = self.by_host.pop(host, None) or Departure()
        departure.count += 1
        departure.waited = waited
        departure.at = now
        self.by_host[host] = departure
        if len(self.by_host) > MOST_HOSTS:
            del self.by_host[next(iter(self.by_host))]
