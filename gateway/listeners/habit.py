"""How often a client asks, and whether it still does."""

from dataclasses import dataclass
from typing import Final, Protocol

from gateway.listeners.session import NEVER
from gateway.routing.access import Rights

#: Whoever asks more often than at this interval asks much, in seconds. Listeners look at their clients more often.
MUCH: Final = 0.4
#: As long as a client has not asked for so many seconds, its interval counts as no shorter.
ORDINARY: Final = 1.0
#: Who has been silent for so many of its intervals does not ask as usual any more.
PATIENCE: Final = 2.0


class Client(Protocol):
    """A connection or a peer."""

    @property
    def host(self) -> str:
        """The address, which decides what the client may do."""

    @property
    def is_idle(self) -> bool:
        """Whether no request of it is under way."""

    @property
    def last_asked(self) -> float:
        """When it asked last, in seconds of the loop's clock, or NEVER."""


@dataclass(slots=True)
class Habit:
    """What looks at a client every now and then have shown. `origin` is what counts as its address.

    `longest` is the longest time that it has lately left between two requests, 0.0 while it has not asked twice. It is
    forgotten once the client has asked for twice as long without another. `interval` is at what interval it asks: a few
    requests in a moment do not tell, the next one may come much later.
    """

    origin: str
    #: When it came, asked last, or was last seen with a request under way.
    active_at: float
    began_at: float = NEVER
    asked_at: float = NEVER
    longest: float = 0.0
    interval: float = ORDINARY
    #: By which rights `is_named` was found: looking up a thousand clients takes milliseconds.
    rights: Rights | None = None
    is_named: bool = False

    def look(self, client: Client, now: float) -> None:
        """Take in what the client has done since the last look."""
        last_asked = client.last_asked
        if last_asked > self.asked_at:
            self._has_asked(last_asked)
        if not client.is_idle:
            self.active_at = now

    def is_named_by(self, rights: Rights, host: str) -> bool:
        """Whether a row gives rights to the address of the client, `host`."""
        if self.rights is not rights:
            self.rights, self.is_named = rights, rights.names(host)
        return self.is_named

    @property
    def was_served(self) -> bool:
        """Whether it has asked: who has no request under way then was answered."""
        return self.asked_at > NEVER

    def has_stopped(self, now: float) -> bool:
        """Whether it has been silent for longer than it usually is."""
        return now - self.active_at >= PATIENCE * max(self.interval, MUCH)

    def is_usual(self, now: float) -> bool:
        """Whether it asks as it usually does, which is known, and not much."""
        return self.longest >= MUCH and not self.has_stopped(now)

    def order(self, now: float) -> tuple[bool, bool, float, float]:
        """For comparing: the greatest is the first to make room."""
        has_stopped, silence = self.has_stopped(now), (now - self.active_at) / self.interval
        shortness = 0.0 if has_stopped else MUCH - min(self.interval, MUCH)
        return not self.was_served, has_stopped, shortness, silence

    def _has_asked(self, at: float) -> None:
        if self.was_served:
            pause = at - self.asked_at
            self.longest = max(pause, self.longest - pause / 2)
        else:
            self.began_at = at
        self.asked_at = self.active_at = at
        self.interval = max(self.longest, 0.0 if at - self.began_at >= ORDINARY else ORDINARY)
