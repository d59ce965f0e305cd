"""What one gateway knows of the store of a lease, and what it has written there itself."""

from math import inf
from typing import Final

from gateway.fleet.lease_entry import LeaseEntry, State
from gateway.timing.lease_time import LOOKS, WAITS

#: At most this many writes without a known result are remembered.
_UNKNOWN: Final = 8


class StoreView:
    """What is known of the store: the latest entry and its revision, since when, and when it was looked at last.

    It has lost entries when it has none, or one whose revision is not above the latest that was seen.
    """

    def __init__(self, ttl: float) -> None:
        self.entry: LeaseEntry | None = None
        self.revision = 0
        self.looked_at = -inf
        #: When it was seen that it has lost entries, last.
        self.is_lost_since = -inf
        #: The longest time to live that was seen, for the case that an entry is lost.
        self.longest = ttl
        self._ttl = ttl
        #: When the latest entry was seen; None: nothing is known.
        self._since: float | None = None
        #: The revision of the latest entry, which may be lost.
        self._latest = 0

    @property
    def is_abandoned_at(self) -> float:
        """From when on nobody can hold the lease by this entry, or by one that was lost."""
        if self._since is None:
            return inf
        seen_until = -inf if self.entry is None else self._since + WAITS * self.entry.ttl
        return max(seen_until, self.is_lost_until)

    @property
    def is_lost_until(self) -> float:
        """From when on nobody can hold the lease by an entry that was lost."""
        return self.is_lost_since + WAITS * self.longest

    def is_fresh(self, now: float) -> bool:
        """Whether it has answered lately: else it may have lost the entry, and counted up to this revision again."""
        return now < self.looked_at + 2 * LOOKS * self._ttl

    def found(self, entry: LeaseEntry | None, revision: int, now: float) -> bool:
        """This was read. Whether it is news."""
        if self._since is not None and (entry, revision) == (self.entry, self.revision):
            self.looked_at = now
            return False
        if revision <= self._latest:
            self.is_lost_since = now
        self.know(entry, revision, now)
        return True

    def know(self, entry: LeaseEntry | None, revision: int, now: float) -> None:
        """This is there since now at the latest."""
        self.entry, self.revision, self._since = entry, revision, now
        self.looked_at = now
        if entry is not None:
            self._latest = revision
            self.longest = max(self.longest, entry.ttl)

    def failed(self) -> None:
        """It has not answered. One that has lost an entry was away: nobody knows since when there is none."""
        self.looked_at = -inf
        if self.entry is None:
            self._since = None


class OwnWrites:
    """What this process writes: `asked` last, and `sent` when if the result is not known, by beat."""

    def __init__(self, holder: str, instance: str, ttl: float) -> None:
        self.asked: LeaseEntry | None = None
        self.sent: dict[int, float] = {}
        self._holder = holder
        self._instance = instance
        self._ttl = ttl
        self._beat = 0
        #: What the store has of us.
        self._state: State = {}

    def is_ours(self, entry: LeaseEntry) -> bool:
        """Whether this process has written it."""
        return entry.instance == self._instance

    def is_news(self, state: State) -> bool:
        """Whether the store has something else, and nothing is under way to it."""
        return state != self._state and not self.sent

    def claim(self, state: State, now: float) -> bytes:
        """We hold the lease from now on."""
        entry = self._next(state)
        if len(self.sent) >= _UNKNOWN:
            del self.sent[min(self.sent)]
        self.sent[entry.beat] = now
        return entry.encode()

    def release(self, state: State, silent: float) -> bytes:
        """We do not hold it any more."""
        self.asked = self._next(state)._replace(is_released=True, silent=silent)
        return self.asked.encode()

    def accepted(self, entry: LeaseEntry) -> None:
        """The store has this."""
        self.sent = {}
        self._state = entry.state

    def refused(self) -> None:
        """The store does not take what was asked last."""
        if self.asked is not None:
            self.sent.pop(self.asked.beat, None)

    def _next(self, state: State) -> LeaseEntry:
        self._beat += 1
        self.asked = LeaseEntry(self._holder, self._instance, self._beat, self._ttl, state=dict(state))
        return self.asked
