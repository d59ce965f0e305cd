"""Remembers which clients were rejected, and why."""

from dataclasses import dataclass
from typing import Final

#: At most this many addresses are kept; the one that was rejected the longest time ago is forgotten first.
MOST_HOSTS: Final = 64


@dataclass(slots=True)
class Rejection:
    """How often clients at one address were rejected, when that was last (in seconds of the loop's clock), and why."""

    count: int = 0
    at: float = 0.0
    reason: str = ""


class Rejections:
    """Those of one listener, by the address of the client."""

    def __init__(self) -> None:
        self.by_host: dict[str, Rejection] = {}

    def add(self, host: str, reason: str, now: float) -> None:
        """A client at `host` is rejected."""
        rejection = self.by_host.pop(host, None) or Rejection()
        rejection.count += 1
        rejection.at = now
        rejection.reason = reason
        self.by_host[host] = rejection
        if len(self.by_host) > MOST_HOSTS:
            del self.by_host[next(iter(self.by_host))]
