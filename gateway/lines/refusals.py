"""The requests that a full queue has refused: an event for each would cost more than what is served."""

from math import inf
from typing import Final

from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction

#: How long the further refusals of a client are counted before they are told together, in seconds.
TOGETHER: Final = 10.0
#: The most clients and devices whose refusals are counted.
MOST: Final = 1000


class _Told:
    """When the further refusals will be told, and how many there are."""

    __slots__ = ("more", "until")

    def __init__(self, until: float) -> None:
        self.until = until
        self.more = 0


class Refusals:
    """Tells of a refusal at once, and TOGETHER later of all further ones of this client and device, with their number.

    `tells_at` is when to call `tell`: infinity if nothing is counted.
    """

    __slots__ = ("_telling", "_told", "tells_at")

    def __init__(self, telling: Telling) -> None:
        self.tells_at = inf
        self._telling = telling
        #: The first is told next.
        self._told: dict[tuple[Destination, str], _Told] = {}

    def add(self, refused: Transaction, now: float) -> None:
        """Tell of a refused request, or count it."""
        if now >= self.tells_at:
            self.tell(now)
        key = refused.device, refused.client
        told = self._told.get(key)
        if told is not None:
            told.more += 1
            return
        if len(self._told) >= MOST:
            self.tell(self.tells_at)
        self._told[key] = _Told(now + TOGETHER)
        self.tells_at = min(self.tells_at, now + TOGETHER)
        self._telling.queue_full(*key)

    def tell(self, now: float) -> None:
        """Tell of the refusals that were counted until `now`."""
        while self._told:
            key, told = next(iter(self._told.items()))
            if told.until > now:
                self.tells_at = told.until
                return
            del self._told[key]
            if told.more:
                self._telling.queue_full(*key, told.more)
        self.tells_at = inf
