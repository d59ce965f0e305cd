"""What lines and units did in the last days, in slots of ten minutes.

A slot has a number: the time since 1970 divided by STEP. Slots in which the gateway did not run are not there. If the
clock was set back, a slot has what happened both times; slots ahead of the clock stay until they are in the past.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from operator import add
from typing import Final, NamedTuple

#: The length of a slot in seconds.
STEP: Final = 600
#: How many slots have what units did, and how many what lines did: those of a day, and of a week.
UNIT_SLOTS: Final = 24 * 3600 // STEP
LINE_SLOTS: Final = 7 * UNIT_SLOTS
#: The most slots that are kept, with those ahead of the clock.
MOST_SLOTS: Final = LINE_SLOTS + UNIT_SLOTS
_PLACES: Final = 4


class UnitUse(NamedTuple):
    """What a unit did: requests of clients, and how those ended that were not answered normally.

    `unsent` are those that the gateway has not sent: the unit rested, the line was down or too busy. `failed` have been
    sent and got no valid response, but not for a time-out. `answer` is the sum of the times of `responses` in seconds,
    and `share` that of their shares of the limit. The unit rested for so many seconds.
    """

    requests: int = 0
    timeouts: int = 0
    failed: int = 0
    unsent: int = 0
    exceptions: int = 0
    responses: int = 0
    answer: float = 0.0
    share: float = 0.0
    resting: float = 0.0

    @property
    def unanswered(self) -> int:
        """The requests without a response of the unit."""
        return self.lost + self.unsent

    @property
    def lost(self) -> int:
        """The requests that were sent, and got no valid response."""
        return self.timeouts + self.failed

    @property
    def unanswered_share(self) -> float:
        """The share of requests without one."""
        return self.unanswered / self.requests if self.requests else 0.0

    def plus(self, other: "UnitUse") -> "UnitUse":
        """Add up both."""
        return UnitUse(*map(add, self, other))


class LineUse(NamedTuple):
    """What a line, or another server, did in so many `seconds`: for how many of them it was busy, and its port down.

    `sent` are requests, and `failed` those of them without a valid response.
    """

    seconds: float = 0.0
    busy: float = 0.0
    down: float = 0.0
    sent: int = 0
    failed: int = 0

    @property
    def busy_share(self) -> float:
        """The share of the time in which nothing else could be sent."""
        return min(self.busy / self.seconds, 1.0) if self.seconds else 0.0

    def plus(self, other: "LineUse") -> "LineUse":
        """Add up both."""
        return LineUse(*map(add, self, other))


class Slot:
    """What happened in one slot: lines by name, and units by name if they did anything."""

    __slots__ = ("lines", "number", "units")

    def __init__(self, number: int) -> None:
        self.number = number
        self.lines: dict[str, LineUse] = {}
        self.units: dict[str, UnitUse] = {}

    def add(self, lines: Mapping[str, LineUse], units: Mapping[str, UnitUse]) -> None:
        """Add what has happened."""
        for name, line in lines.items():
            self.lines[name] = self.lines.get(name, LineUse()).plus(line)
        for name, unit in units.items():
            self.units[name] = self.units.get(name, UnitUse()).plus(unit)

    def copy(self) -> "Slot":
        """Copy it: nothing is added to the copy any more."""
        slot = Slot(self.number)
        slot.lines, slot.units = dict(self.lines), dict(self.units)
        return slot

    def as_text(self) -> str:
        """Write all of it, for a file."""
        return json.dumps({"lines": _rounded(self.lines), "units": _rounded(self.units)}, separators=(",", ":"))

    @classmethod
    def read(cls, number: int, text: str) -> "Slot":
        """Read what `as_text` has written.

        Raises:
            ValueError: it has not.
        """
        slot = cls(number)
        try:
            content = json.loads(text)
            slot.lines = {name: LineUse().plus(LineUse(*use)) for name, use in content["lines"].items()}
            slot.units = {name: UnitUse().plus(UnitUse(*use)) for name, use in content["units"].items()}
        except (AttributeError, LookupError, RecursionError, TypeError) as error:
            raise ValueError(str(error)) from error
        return slot


def together(uses: Iterable[UnitUse | None]) -> UnitUse:
    """Add up all uses; None counts as nothing done."""
    there = [use for use in uses if use is not None]
    return UnitUse(*map(sum, zip(*there, strict=True))) if there else UnitUse()


class Past(NamedTuple):
    """Slots one after another, the first with this number; None where the gateway did not run.

    A number is a time since 1970 divided by `step`, in seconds.
    """

    first: int
    slots: Sequence[Slot | None]
    step: int = STEP


class Changes(NamedTuple):
    """Slots that a file does not have yet, and the numbers of those that it has no longer to keep."""

    written: Sequence[Slot]
    gone: frozenset[int]


class History:
    """The slots of the last days. A unit's are kept for a day, a line's for a week."""

    def __init__(self) -> None:
        self._slots: dict[int, Slot] = {}
        self._now = 0
        self._changed: set[int] = set()
        self._gone: set[int] = set()

    def add(self, time: float, lines: Mapping[str, LineUse], units: Mapping[str, UnitUse]) -> None:
        """Add what has happened shortly before `time`, in seconds since 1970."""
        number = slot_at(time)
        self._slot(number).add(lines, units)
        if number != self._now:
            self._now = number
            self._forget()

    def load(self, slots: Iterable[Slot]) -> None:
        """Add what an earlier run has kept."""
        for slot in slots:
            if slot.number in self._slots:
                self._slot(slot.number).add(slot.lines, slot.units)
            else:
                self._slots[slot.number] = slot
        self._forget()

    def last(self, time: float, count: int) -> Past:
        """Return the last `count` slots up to the one at `time`."""
        end = slot_at(time) + 1
        return Past(end - count, [self._slots.get(number) for number in range(end - count, end)])

    def changes(self) -> Changes:
        """Take what has changed since the last time."""
        changed, self._changed = self._changed, set()
        gone, self._gone = self._gone, set()
        return Changes([self._slots[number].copy() for number in sorted(changed)], frozenset(gone))

    def put_back(self, changes: Changes) -> None:
        """Take back changes that could not be written."""
        self._changed.update(self._slots.keys() & {slot.number for slot in changes.written})
        self._gone.update(changes.gone - self._slots.keys())

    def change_all(self) -> None:
        """Count all of it as changed: nothing of it is in the file any more."""
        self._changed.update(self._slots)

    def _slot(self, number: int) -> Slot:
        self._changed.add(number)
        self._gone.discard(number)
        return self._slots.setdefault(number, Slot(number))

    def _forget(self) -> None:
        """Drop what is too old; if there is too much all the same, what is farthest ahead."""
        ahead = sorted(number for number in self._slots if number > self._now - LINE_SLOTS)
        for number in self._slots.keys() - set(ahead[:MOST_SLOTS]):
            del self._slots[number]
            self._changed.discard(number)
            self._gone.add(number)
        for number, slot in self._slots.items():
            if number <= self._now - UNIT_SLOTS and slot.units:
                slot.units = {}
                self._changed.add(number)


def slot_at(time: float) -> int:
    """Compute the number of the slot at `time`, in seconds since 1970."""
    return int(time // STEP)


def _rounded(uses: Mapping[str, UnitUse | LineUse]) -> dict[str, list[float]]:
    return {name: [round(number, _PLACES) for number in use] for name, use in uses.items()}
