"""The requests that a full queue has refused: an event for each would cost more than what is served."""

from math import inf
from typing import Final

from gateway.lines.telling import Telling
from gateway.lines.transaction import Destination, Transaction

#: How long the further refusals of a client are counted before they are told together, in seconds. With a pause of ten
#: the log would take them for new ones each time, and never go over to one line a minute.
TOGETHER: Final = 5.0
#: The most clients and devices whose refusals are counted.
MOST: Final = 1000


class _Told:
    """When the further refusals will be told, and how many there are."""

    __slots__ = ("more", "until")

    def __init__(self, until: float) -> None:
        self.until = until
        self.more = 0


class Refusals:
    """Tells of a refusal at once, and each TOGETHER of all further ones of this client and device, with their number.

    After a time without any, the next one is told at once again. `tells_at` is when to call `tell`: infinity if nothing
    is counted.
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
            self._tell_first()
        self._count(key, now + TOGETHER)
        self._telling.queue_full(*key)

    def tell(self, now: float) -> None:
        """Tell of the refusals that were counted until `now`; infinity ends it."""
        while self._told and self.tells_at <= now:
            key, told = self._tell_first()
            if told.more and now < inf:
                self._count(key, told.until + TOGETHER)

    def _count(self, key: tuple[Destination, str], until: float) -> None:
        self._told[key] = _Told(until)
        self.tells_at = min(self.tells_at, until)

    def _tell_first(self) -> tuple[tuple[Destination, str], _Told]:
        key, told = next(iter(self._told.items()))
        del self._told[key]
        self.tells_at = next((each.until for each in self._told.values()), inf)
        if told.more:
            self._telling.queue_full(*key, told.more)
        return key, told
