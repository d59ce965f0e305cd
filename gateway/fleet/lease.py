"""The lease of a line: of all gateways that name it, at most one writes to the line at any time (ADR 26).

A lease is one entry in a key-value store, which accepts a change only from a writer that names the latest revision. The
holder renews it. It may write for a time that begins when it *sent* a renewal; the others wait for a time that begins
when they *saw* the latest one. Only the machine's own CLOCK_BOOTTIME is used, and only for differences:

    holder   |-- writes ---------------->|-- guard -->|                  sent + HOLDS x time to live: the end
    others         |-- wait ------------------------------------>|       seen + WAITS x time to live: one may take it

The guard is longer than any transaction on the line, so the last one of the holder is over when its share ends. The
distance between the two ends allows the rates of the clocks to differ by a fifth.

| state   | event                                                          | next    | action                      |
|---------|----------------------------------------------------------------|---------|-----------------------------|
| standby | the entry was released, is ours, or nobody renewed it in time  | standby | it is written: a claim      |
| standby | the store has lost an entry, and all that others may know ended| standby | it is written: a claim      |
| standby | a claim was accepted                                           | held    | after a silence, writing    |
| held    | a renewal is due                                               | held    | it is written               |
| held    | the entry is somebody else's                                   | standby | nothing is written any more |
| held    | our share ends without a renewal                               | standby | nothing is written any more |
| held    | another client was heard on the line                           | standby | the entry is released       |
| held    | `release`                                                      | standby | the entry is released       |

A store without an entry, or with one older than an entry seen before, has lost data.

There is no I/O here: time is an argument, `next` says what to ask of the store, and the caller reports the result.
"""

from dataclasses import dataclass
from math import inf
from typing import Final, Literal, NamedTuple

from gateway.fleet.lease_entry import LeaseEntry, State
from gateway.fleet.lease_records import OwnWrites, StoreView
from gateway.timing.lease_time import HOLDS, LOOKS

#: Renewals per time in which the holder may write.
_RENEWALS: Final = 3
#: The reason after a rollback of the store.
_OLDER: Final = "NATS came back with an older entry"


@dataclass(frozen=True, slots=True)
class LeaseSettings:
    """The settings of one lease; all times in seconds.

    `ttl` is its time to live without a renewal. `guard` is longer than any transaction on the line; an answer may still
    come for `late` seconds after that. `fallback` is what the holder does when the store cannot be reached.
    """

    name: str
    ttl: float
    guard: float
    late: float
    fallback: Literal["release", "hold"] = "release"

    @property
    def writes_for(self) -> float:
        """How long the holder may write after sending a renewal, in seconds."""
        return HOLDS * self.ttl - self.guard

    @property
    def step(self) -> float:
        """Time between renewals, and the limit of each call of the store, in seconds."""
        return self.writes_for / _RENEWALS


class Read(NamedTuple):
    """The call that reads the entry."""


class Write(NamedTuple):
    """The call that writes `value` if the entry still has this `revision`; 0 means that there is no entry."""

    value: bytes
    revision: int


StoreCall = Read | Write


class Lease:
    """One lease, for the process `instance` of the gateway `holder`.

    Writing to the line may begin at `silent_until` and must have stopped at `until`, both by CLOCK_BOOTTIME. The caller
    sets `state`, which the next holder gets. `inherited` is the state left by another holder, None if there was none
    since this gateway held the lease; the caller sets it to None when it has adopted it.
    """

    def __init__(self, settings: LeaseSettings, holder: str, instance: str) -> None:
        self.settings = settings
        self.is_held = False
        self.until = -inf
        self.silent_until = -inf
        self.state: State = {}
        self.inherited: State | None = None
        #: Why it is not held; empty if it is.
        self.reason = "not asked for yet"
        #: Why the last call of the store failed; empty if it did not.
        self.trouble = ""
        self._store = StoreView(settings.ttl)
        self._writes = OwnWrites(holder, instance, settings.ttl)
        #: When the renewal was sent that our share counts from.
        self._counts_from = -inf
        self._must_read = True
        self._asks_at = -inf
        self._claims_from = -inf
        #: Whether another gateway has held it since we did, so that its state must be inherited.
        self._inherits = False
        #: How long the line must be silent after a claim, in seconds, because of the last entry that was not ours.
        self._silence = settings.late
        #: Whether the entry must still be written as released.
        self._releases = False

    @property
    def holder(self) -> str:
        """The holder as far as known; empty if there is none."""
        entry = self._store.entry
        return "" if entry is None or entry.is_released else entry.holder

    def may_send(self, now: float) -> bool:
        """Tell whether a request may be written to the line."""
        return now < self.until

    def next(self, now: float) -> StoreCall | None:
        """Return the store call that is due, if any. Report its result before calling this again."""
        self.tick(now)
        if self._releases:
            return self._release(now)
        if self._must_read:
            return Read()
        if self.is_held:
            is_due = now >= self._asks_at or self._writes.is_news(self.state)
            return self._write(self.state, now) if is_due else None
        if self._store.is_fresh(now) and now >= max(self._claims_at, self._claims_from):
            return self._claim(now)
        return Read() if now >= self._asks_at else None

    def deadline(self) -> float:
        """Return the latest time to call `next`."""
        if self._must_read or self._releases:
            return -inf
        if self.is_held:
            return min(self._asks_at, self._ends_at)
        claims_at = max(self._claims_at, self._claims_from, self._store.looked_at)
        return min(self._asks_at, claims_at) if self._store.is_fresh(claims_at) else self._asks_at

    def tick(self, now: float) -> None:
        """Let time pass: the share may end."""
        if self.is_held and now >= self._ends_at:
            self._drop(f"it could not be renewed in time{self.trouble and f': {self.trouble}'}")

    def found(self, value: bytes | None, revision: int, now: float) -> None:
        """Take the result of a Read; `value` is None if there is no entry."""
        self.tick(now)
        self._must_read = False
        self._asks_at = now + LOOKS * self.settings.ttl
        self.trouble = ""
        entry = None if value is None else LeaseEntry.decode(value, self._store.longest)
        is_older = self._note(entry, revision, now)
        if entry is None:
            self._found_none(now)
        elif self._writes.is_ours(entry):
            sent_at = self._writes.sent.get(entry.beat)
            if sent_at is not None and not entry.is_released:
                self._accept(sent_at, entry, now)
        else:
            self._found_another(entry, is_older=is_older)

    def written(self, revision: int, now: float) -> None:
        """Take the result of a Write that succeeded, with the new revision."""
        self.tick(now)
        entry = self._writes.asked
        if entry is None:
            return
        self._store.know(entry, revision, now)
        if not entry.is_released:
            self._accept(self._writes.sent[entry.beat], entry, now)

    def refused(self, now: float) -> None:
        """Take the result of a Write that met another revision: of another gateway, or of an earlier write of ours."""
        self.tick(now)
        self._writes.refused()
        self._must_read = True

    def failed(self, reason: str, now: float) -> None:
        """Take the failure of a store call. Whether it was carried out is unknown."""
        self.tick(now)
        self.trouble = reason
        if not self.is_held and not self.holder:
            self.reason = reason
        self._asks_at = now + (self.settings.step if self.is_held else LOOKS * self.settings.ttl)
        self._must_read = False
        self._store.failed()
        if self.is_held and self.settings.fallback == "hold":
            self.until = self._counts_from = inf

    def heard_other(self, now: float) -> None:
        """Stop writing because another client was heard. Claim again only after a time to live without one."""
        if self.is_held:
            self._drop("another client was heard on the line")
            self._give_back(self.settings.guard + self.settings.late)
            self._claims_from = now + self.settings.ttl

    def give_way(self, now: float, reason: str) -> None:
        """Release the lease because the line cannot be used from here. Others have time to claim it first."""
        if self.is_held:
            self._drop(reason)
            self._give_back(self.settings.guard + self.settings.late)
            self._claims_from = now + 3 * LOOKS * self.settings.ttl

    def release(self, silent: float, state: State) -> None:
        """Give the lease back for good, with `state` for the next holder.

        `silent` is how long something of ours may still be on the line, in seconds.
        """
        if self.is_held:
            self.state = state
            self._drop("it was released")
            self._give_back(silent)
        self._claims_from = inf

    @property
    def _ends_at(self) -> float:
        return self._counts_from + HOLDS * self.settings.ttl

    @property
    def _claims_at(self) -> float:
        """The earliest time for a claim, as far as known."""
        entry = self._store.entry
        if entry is not None and (entry.is_released or self._writes.is_ours(entry)):
            return self._store.is_lost_until
        return self._store.is_abandoned_at

    def _found_none(self, now: float) -> None:
        """Write the entry again at once if the lease is held: others cannot take it before our share ends."""
        if self.is_held:
            self._asks_at = now
        else:
            self.reason = "nobody holds it; it may be taken soon"

    def _note(self, entry: LeaseEntry | None, revision: int, now: float) -> bool:
        """Note what was read. Return True if the store has lost a later entry."""
        is_news = self._store.found(entry, revision, now)
        is_older = is_news and entry is not None and self._store.is_lost_since == now
        if is_news:
            self._require_silence(None if is_older else entry)
        if is_older and not self.is_held:
            self.reason = f"{_OLDER}; it may be taken soon"
        return is_older

    def _found_another(self, entry: LeaseEntry, *, is_older: bool) -> None:
        """Give up the lease, if it is held: our earlier writes cannot take effect any more."""
        self._writes.sent = {}
        if self.is_held:
            self._drop(_OLDER if is_older else f"{entry.holder} has taken it")
        elif not entry.is_released and not is_older:
            self.reason = f"{entry.holder} holds it"

    def _require_silence(self, entry: LeaseEntry | None) -> None:
        """Require silence if another gateway has used the line, or may have after an entry that was lost."""
        if entry is None:
            self._silence = self.settings.late
        elif not self._writes.is_ours(entry):
            self._silence = entry.silent if entry.is_released else self.settings.late

    def _claim(self, now: float) -> Write:
        """Write the entry for us. The state of another holder is kept until it is inherited."""
        entry = self._store.entry
        self._inherits |= entry is not None and not self._writes.is_ours(entry)
        return self._write(entry.state if self._inherits and entry is not None else self.state, now)

    def _write(self, state: State, now: float) -> Write:
        return Write(self._writes.claim(state, now), self._store.revision)

    def _give_back(self, silent: float) -> None:
        self._releases = True
        self._silence = max(self._silence, silent)

    def _release(self, now: float) -> Write | None:
        """Return the write that frees the lease, tried once. The next holder must be silent as long as we had to be."""
        self._releases = False
        self._asks_at = now + LOOKS * self.settings.ttl
        entry = self._store.entry
        if entry is None or not self._writes.is_ours(entry):
            return None
        silent = max(self._silence, self.silent_until - now)
        return Write(self._writes.release(self.state, silent), self._store.revision)

    def _accept(self, sent_at: float, entry: LeaseEntry, now: float) -> None:
        """Count our share from when the entry was sent."""
        self._writes.accepted(entry)
        self._asks_at = sent_at + self.settings.step
        if not self.is_held:
            if now < self._claims_from:
                self._releases = True
                return
            if now >= sent_at + self.settings.writes_for:
                self._asks_at = now
                return  # too late for this share; the entry is ours, so the next claim need not wait
            self._take(entry, now)
        self._counts_from = sent_at
        self.until = sent_at + self.settings.writes_for
        self.reason = self.trouble = ""

    def _take(self, entry: LeaseEntry, now: float) -> None:
        self.is_held = True
        if self._inherits:
            self._inherits = False
            self.inherited = self.state = entry.state
        self.silent_until = max(self.silent_until, now + self._silence)
        self._silence = 0.0

    def _drop(self, reason: str) -> None:
        self.is_held = False
        self.until = self._counts_from = -inf
        self.reason = reason

    def __repr__(self) -> str:
        state = "held" if self.is_held else f"standby: {self.reason}"
        return f"<Lease {self.settings.name} {state}>"
