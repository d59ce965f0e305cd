"""What readers want of a device, and the requests that read it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.images.polls import Poll
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Split


@dataclass(slots=True)
class PollCounts:
    """Polls for a reader that were sent, and those of them that failed."""

    polls: int = 0
    failed: int = 0


class Reader(Protocol):
    """A mirror, a virtual unit, or what is published.

    `label` and `place` are for logs: `mirror silo`, and where that is in the config.
    """

    counts: PollCounts

    @property
    def label(self) -> str:
        """See above."""

    @property
    def place(self) -> str:
        """See above."""

    def took(self, items: Sequence[tuple["Part", bytes]], now: float) -> None:
        """Take the items of parts that one request has read: two bytes for a register, one for a bit."""

    def missed(self, parts: Sequence["Part"], now: float, *, answers: bool | None) -> None:
        """Note that parts were not read. `answers`: whether the device answers; None if it was not asked."""

    def settle(self, parts: Sequence["Part"], now: float) -> None:
        """Go on with what waited for a poll of one of these parts, which may be those of others."""


class Part:
    """The addresses of `poll`, which a reader wants, and the age of their values. They are unknown at first.

    One request reads all of it.
    """

    __slots__ = ("_changed_by", "_sampled_after", "is_awaited", "poll", "polled_by", "reader", "sampled_at", "span")

    def __init__(self, poll: Poll, reader: Reader) -> None:
        self.poll = poll
        self.span = poll.span
        self.reader = reader
        #: The request that reads it at present, if one does.
        self.polled_by: PolledRange | None = None
        #: Whether reads wait for its poll while the values are unknown.
        self.is_awaited = True
        #: When the last answered poll was submitted.
        self.sampled_at: float | None = None
        # Numbers of finished writes: when that poll was submitted, and up to the last one that may have changed values.
        self._sampled_after = 0
        self._changed_by = 0

    @property
    def is_urgent(self) -> bool:
        """Whether its values are unknown, and reads may wait for the next poll."""
        return self.is_awaited and not self.is_known(self._changed_by)

    def sampled(self, at: float, writes: int) -> None:
        """Note that a poll submitted at this time, after so many writes, was answered."""
        self.sampled_at, self._sampled_after = at, writes

    def changed(self, writes: int) -> None:
        """Forget its values, which the last write may have changed."""
        self._changed_by = writes
        self.is_awaited = True

    @property
    def changed_at(self) -> tuple[Span, ...]:
        """The addresses at which a write may change its values."""
        return (self.span,)

    def go_on_from(self, old: "Part") -> None:
        """Have the age of a part of the same polls that this one replaces."""
        self.sampled_at, self.is_awaited = old.sampled_at, old.is_awaited
        self._sampled_after, self._changed_by = old._sampled_after, old._changed_by  # noqa: SLF001 - of its own kind

    def is_known(self, writes: int) -> bool:
        """Tell whether its values include the first `writes` writes."""
        return self.sampled_at is not None and self._sampled_after >= min(self._changed_by, writes)

    def is_lost(self, now: float, stale: float, writes: int) -> bool:
        """Tell whether its values are stale at `now`, or unknown and no poll is in progress."""
        if self.sampled_at is None or not self.is_known(writes):
            return not self.is_awaited
        return now - self.sampled_at > stale

    def age(self, now: float) -> float | None:
        """Return the age of its values in seconds; None while they are unknown."""
        if self.sampled_at is None or not self.is_known(self._changed_by):
            return None
        return now - self.sampled_at


class PolledRange:
    """A request that repeats, for `parts`. While the device refuses it, its `halves` are read instead.

    If these are the two sides of a hole they are parts of its `split`. `within` is the split of which it is itself a
    part that was not read yet. `is_over`: it is not sent any more.
    """

    __slots__ = (
        "_asked_at", "_places", "asked_after", "due_at", "halves", "is_asked", "is_over", "is_refused", "is_waiting",
        "parts", "poll", "split", "within",
    )  # fmt: skip

    def __init__(self, poll: Poll, parts: Sequence[Part], due_at: float, within: Split | None = None) -> None:
        self.poll = poll
        self.due_at = due_at
        self.within = within
        self.split: Split | None = None
        self.halves: list[PolledRange] = []
        #: Whether its poll waits, or is in progress.
        self.is_asked = self.is_refused = self.is_over = False
        #: Whether its poll waits for its turn.
        self.is_waiting = False
        self._asked_at = 0.0
        #: The number of writes that had finished when its last poll was sent.
        self.asked_after = 0
        self.serve(parts)

    def serve(self, parts: Sequence[Part]) -> None:
        """Read for these parts from now on, instead of others that want the same."""
        self.parts = parts
        #: The parts of each reader, with the place of their items among those that are read.
        self._places: dict[Reader, list[tuple[Part, int, int]]] = {}
        for part in parts:
            place = self.poll.place(part.poll)
            self._places.setdefault(part.reader, []).append((part, place.start, place.stop))
            part.polled_by = self
        for half in self.halves:
            half.serve(self._parts_of(half.poll))

    def is_due_at(self, at: float) -> bool:
        """Tell whether its poll is to be sent at this time: not while the last one waits or is in progress."""
        return self.due_at == at and not self.is_asked and not self.is_over

    @property
    def is_urgent(self) -> bool:
        """Whether one of its parts is, and no poll is sent or waits that may be for it."""
        return not self.is_asked and not self.halves and any(part.is_urgent for part in self.parts)

    @property
    def is_written(self) -> bool:
        """Whether a write may have changed values of it that were known: reads wait for its poll."""
        return any(part.is_urgent and part.sampled_at is not None for part in self.parts)

    @property
    def readers(self) -> tuple[Reader, ...]:
        """The readers of its parts."""
        return tuple(self._places)

    def asked(self, now: float, writes: int) -> None:
        """Note that its poll is sent, after so many writes."""
        self._asked_at, self.asked_after = now, writes

    def take(self, items: bytes, now: float) -> None:
        """Hand the items that were read to the readers, but to those who have newer ones.

        The age of the parts counts from the submission of the poll.
        """
        for reader, places in self._places.items():
            reader.counts.polls += 1
            newer = [each for each in places if each[0].sampled_at is None or each[0].sampled_at <= self._asked_at]
            reader.took([(part, items[start:end]) for part, start, end in newer], now)
            for part, _, _ in newer:
                part.sampled(self._asked_at, self.asked_after)

    def missed(self, now: float, *, answers: bool | None, was_sent: bool = False) -> None:
        """Tell the readers that there was no answer: reads do not wait for the next poll. Of `halves` these tell."""
        for reader, places in self._places.items():
            reader.counts.polls += was_sent
            reader.counts.failed += was_sent
            if self.halves:
                continue
            parts = [part for part, _, _ in places]
            for part in parts:
                part.is_awaited = False
            reader.missed(parts, now, answers=answers)

    def half(self, poll: Poll, now: float) -> "PolledRange":
        """Add a part of it that is read instead."""
        half = PolledRange(poll, self._parts_of(poll), now, self.split)
        for part in half.parts:
            part.is_awaited = True
        self.halves.append(half)
        return half

    def _parts_of(self, poll: Poll) -> list[Part]:
        wanted = set(poll.wanted)
        return [part for part in self.parts if part.poll in wanted]
