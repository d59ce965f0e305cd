"""How often a client asks, and whether it still does."""

from dataclasses import dataclass
from typing import Final, Protocol

from gateway.listeners.session import NEVER
from gateway.routing.access import Rights

#: Who has left so many seconds between two requests has shown its interval. Listeners look at their clients more often.
PAUSE: Final = 0.4
#: Who asks more often has shown it after so many seconds on a connection. Until then its interval counts as no shorter.
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
class Activity:
    """What looks at a client every now and then have shown. `origin` is what counts as its address.

    `longest` is the longest time that it has lately left between two requests, 0.0 while it has not asked twice. It is
    forgotten once the client has asked for twice as long without another. `interval` is at what interval it asks: a few
    requests in a moment do not tell, the next one may come much later.

    `began_at` is when it first asked, on the connection on which its interval was shown or will be.
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

    @property
    def is_known(self) -> bool:
        """Whether it has shown at what interval it asks."""
        return self.longest >= PAUSE or self._has_asked_for_long

    def has_stopped(self, now: float) -> bool:
        """Whether it has been silent for longer than it usually is."""
        return now - self.active_at >= PATIENCE * max(self.interval, PAUSE)

    def is_usual(self, now: float) -> bool:
        """Whether it asks as it usually does, which is known."""
        return self.is_known and not self.has_stopped(now)

    def order(self, now: float) -> tuple[bool, bool, float]:
        """For comparing: the greatest is the first to make room."""
        return not self.was_served, self.has_stopped(now), (now - self.active_at) / self.interval

    def come_back(self, now: float) -> None:
        """It has connected again. Who was closed before its interval was known shows that anew."""
        self.active_at = now
        if not self._has_asked_for_long:
            self.began_at = NEVER

    @property
    def _has_asked_for_long(self) -> bool:
        return self.asked_at - self.began_at >= ORDINARY

    def _has_asked(self, at: float) -> None:
        if self.was_served:
            pause = at - self.asked_at
            self.longest = max(pause, self.longest - pause / 2)
        if self.began_at == NEVER:
            self.began_at = at
        self.asked_at = self.active_at = at
        self.interval = max(self.longest, 0.0 if self._has_asked_for_long else ORDINARY)
