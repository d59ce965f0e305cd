"""The last time of a fault: after a while without it, it has probably been repaired, although it stays counted."""

from dataclasses import dataclass
from typing import Final

from gateway.config.values.duration import show_age
from gateway.diagnosis.finding import Level

#: A fault counts as over after RECENT seconds and REQUESTS requests without it, or after OVER seconds.
RECENT: Final = 60.0
REQUESTS: Final = 100
OVER: Final = 300.0


@dataclass(frozen=True, slots=True)
class Last:
    """The last time of a fault: `ago` in seconds, and the number of requests `since` then without it."""

    ago: float = 0.0
    since: int = 0

    @property
    def level(self) -> Level:
        """`note` once it is probably over, else `fix`."""
        return "note" if self.ago > OVER or (self.ago > RECENT and self.since >= REQUESTS) else "fix"

    def __str__(self) -> str:
        """Return the addition to the finding; empty while it is recent."""
        return f", the last one {show_age(1000 * self.ago)} ago" if self.ago > RECENT else ""


#: The default where the time is unknown.
NOW: Final = Last()
