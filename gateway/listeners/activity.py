"""At what interval a client sends requests, and whether it still does."""

from dataclasses import dataclass
from typing import Final, Protocol

from gateway.listeners.session import NEVER
from gateway.request import Caller
from gateway.routing.access import Rights

#: A pause of this many seconds between two requests shows a client's interval. Listeners look more often than that.
PAUSE: Final = 0.4
#: A client that polls faster shows its interval after this many seconds on a connection; until then, it counts as this.
ORDINARY: Final = 1.0
#: A client that is silent for more than this many of its intervals has stopped.
PATIENCE: Final = 2.0


class Client(Protocol):
    """A connection or a peer."""

    @property
    def caller(self) -> Caller:
        """The client of units that it is."""

    @property
    def role(self) -> str | None:
        """The role in its certificate, None if it has shown none."""

    @property
    def is_idle(self) -> bool:
        """Whether it has no request in progress."""

    @property
    def last_asked(self) -> float:
        """When it last sent a request, in seconds of the loop's clock, or NEVER."""


@dataclass(slots=True)
class Activity:
    """What is known of a client from periodic looks at it. `origin` is what counts as its address.

    `longest` is the longest recent time between two requests, 0.0 before the second one. It is forgotten after twice
    that time without such a pause. `interval` is the polling interval: a few requests at once do not show it, because
    the next one may come much later.

    `began_at` is when it sent its first request on the connection that shows its interval.
    """

    origin: str
    #: When it connected, last sent a request, or was last seen with one in progress.
    active_at: float
    began_at: float = NEVER
    asked_at: float = NEVER
    longest: float = 0.0
    interval: float = ORDINARY
    #: The rights that `is_named` was found with: looking up a thousand clients takes milliseconds.
    rights: Rights | None = None
    is_named: bool = False

    def look(self, client: Client, now: float) -> None:
        """Update this from what the client has done since the last look."""
        last_asked = client.last_asked
        if last_asked > self.asked_at:
            self._has_asked(last_asked)
        if not client.is_idle:
            self.active_at = now

    def is_named_by(self, rights: Rights, client: Client) -> bool:
        """Whether a row gives rights to the address of the client."""
        if self.rights is not rights:
            self.rights, self.is_named = rights, rights.names(client.caller.host, client.role)
        return self.is_named

    @property
    def was_served(self) -> bool:
        """Whether it has sent a request. If none is in progress, it was answered."""
        return self.asked_at > NEVER

    @property
    def is_known(self) -> bool:
        """Whether its interval is known."""
        return self.longest >= PAUSE or self._has_asked_for_long

    def has_stopped(self, now: float) -> bool:
        """Whether it has been silent for longer than usual."""
        return now - self.active_at >= PATIENCE * max(self.interval, PAUSE)

    def is_usual(self, now: float) -> bool:
        """Whether its interval is known and it keeps to it."""
        return self.is_known and not self.has_stopped(now)

    def order(self, now: float) -> tuple[bool, bool, float]:
        """The sort key: the client with the greatest is replaced first."""
        return not self.was_served, self.has_stopped(now), (now - self.active_at) / self.interval

    def come_back(self, now: float) -> None:
        """It has connected again. If its interval was not known, it is measured anew."""
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
