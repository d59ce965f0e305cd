"""When something happened last: what was repaired is over after a while, although it stays counted."""

from dataclasses import dataclass
from typing import Final

from gateway.config.values.duration import show_age
from gateway.diagnosis.finding import Level

#: Something counts as over if it has not happened for RECENT seconds and for REQUESTS requests, or for OVER seconds.
RECENT: Final = 60.0
REQUESTS: Final = 100
OVER: Final = 300.0


@dataclass(frozen=True, slots=True)
class Last:
    """When something happened last: `ago` in seconds, and the number of requests `since` then without it."""

    ago: float = 0.0
    since: int = 0

    @property
    def level(self) -> Level:
        """A `note` once it is probably over."""
        return "note" if self.ago > OVER or (self.ago > RECENT and self.since >= REQUESTS) else "fix"

    def __str__(self) -> str:
        """What is added to the finding; nothing as long as it is recent."""
        return f", the last one {show_age(1000 * self.ago)} ago" if self.ago > RECENT else ""


#: Where it is not known better.
NOW: Final = Last()
