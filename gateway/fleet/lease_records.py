"""What one gateway knows of a lease's store, and what it has written there."""

from math import inf
from typing import Final

from gateway.fleet.lease_entry import LeaseEntry, State
from gateway.timing.lease_time import LOOKS, WAITS

#: The most writes with an unknown result that are remembered.
_UNKNOWN: Final = 8


class StoreView:
    """The latest known entry and its revision, since when it is known, and the time of the last answer.

    The store has lost entries if it has none, or one whose revision is not above the latest seen.
    """

    def __init__(self, ttl: float) -> None:
        self.entry: LeaseEntry | None = None
        self.revision = 0
        self.looked_at = -inf
        #: When a loss of entries was last seen.
        self.is_lost_since = -inf
        #: The longest time to live seen, in seconds: a lost entry may have had it.
        self.longest = ttl
        self._ttl = ttl
        #: When the latest entry was seen; None if nothing is known.
        self._since: float | None = None
        #: The latest revision seen, whose entry may be lost.
        self._latest = 0

    @property
    def is_abandoned_at(self) -> float:
        """Time after which no holder can count on the known entry, nor on a lost one."""
        if self._since is None:
            return inf
        seen_until = -inf if self.entry is None else self._since + WAITS * self.entry.ttl
        return max(seen_until, self.is_lost_until)

    @property
    def is_lost_until(self) -> float:
        """Time after which no holder can count on a lost entry."""
        return self.is_lost_since + WAITS * self.longest

    def is_fresh(self, now: float) -> bool:
        """Tell whether it has answered lately. If not, it may have lost the entry, and reused this revision."""
        return now < self.looked_at + 2 * LOOKS * self._ttl

    def found(self, entry: LeaseEntry | None, revision: int, now: float) -> bool:
        """Take what was read at `now`. Return True if it differs from what was known."""
        if self._since is not None and (entry, revision) == (self.entry, self.revision):
            self.looked_at = now
            return False
        if revision <= self._latest:
            self.is_lost_since = now
        self.know(entry, revision, now)
        return True

    def know(self, entry: LeaseEntry | None, revision: int, now: float) -> None:
        """Note that this entry exists now."""
        self.entry, self.revision, self._since = entry, revision, now
        self.looked_at = now
        if entry is not None:
            self._latest = revision
            self.longest = max(self.longest, entry.ttl)

    def failed(self) -> None:
        """Note that the store did not answer. It may lose entries meanwhile, so a missing entry tells nothing."""
        self.looked_at = -inf
        if self.entry is None:
            self._since = None


class OwnWrites:
    """The writes of this process: the last one in `asked`, and by beat the times of those with unknown result."""

    def __init__(self, holder: str, instance: str, ttl: float) -> None:
        self.asked: LeaseEntry | None = None
        self.sent: dict[int, float] = {}
        self._holder = holder
        self._instance = instance
        self._ttl = ttl
        self._beat = 0
        #: The state in the store.
        self._state: State = {}

    def is_ours(self, entry: LeaseEntry) -> bool:
        """Tell whether this process has written the entry."""
        return entry.instance == self._instance

    def is_news(self, state: State) -> bool:
        """Tell whether `state` differs from the store's, and no write is under way."""
        return state != self._state and not self.sent

    def claim(self, state: State, now: float) -> bytes:
        """Encode the next entry that claims or renews the lease, and note when it was sent."""
        entry = self._next(state)
        if len(self.sent) >= _UNKNOWN:
            del self.sent[min(self.sent)]
        self.sent[entry.beat] = now
        return entry.encode()

    def release(self, state: State, silent: float) -> bytes:
        """Encode an entry that releases the lease."""
        self.asked = self._next(state)._replace(is_released=True, silent=silent)
        return self.asked.encode()

    def accepted(self, entry: LeaseEntry) -> None:
        """Note that the store has this entry."""
        self.sent = {}
        self._state = entry.state

    def refused(self) -> None:
        """Note that the store has rejected the last write."""
        if self.asked is not None:
            self.sent.pop(self.asked.beat, None)

    def _next(self, state: State) -> LeaseEntry:
        self._beat += 1
        self.asked = LeaseEntry(self._holder, self._instance, self._beat, self._ttl, state=dict(state))
        return self.asked
