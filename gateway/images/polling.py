"""Polls the device of a mirror and keeps the values, range by range.

The age of a value counts from the submission of its poll, so a value is never older than its age.

Order is counted in writes: `writes` is the number of finished writes to the device. The response to a poll includes all
writes that had finished when the poll was submitted. It may lack later ones, because several requests can be on the way
to the device.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

from gateway.errors import Busy, PathUnavailable
from gateway.events import Emit, PollRefused
from gateway.images.polls import MirrorSettings, Poll, joined
from gateway.images.tables import make_tables
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes, Split
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import has_bits, items_read, pack_bits
from gateway.request import Origin, Request

#: Exceptions that refuse a range as a whole: address, quantity, and 04, which some devices send instead.
_REFUSALS: Final = frozenset({2, 3, 4})
#: The pause before repeating a poll that was not sent, because the line is down or busy, in seconds.
UNSENT_PAUSE: Final = 0.25
#: The most polls of a mirror in progress or waiting. More would only fill the queue of the line.
MOST_POLLS: Final = 16


@dataclass(slots=True)
class MirrorCounts:
    """Counters of a mirror."""

    requests: int = 0
    exceptions: int = 0
    polls: int = 0
    failed_polls: int = 0


class MirrorOrigin(Origin, Protocol):
    """The Origin of a mirror's polls and of the requests that it passes on."""

    def passed(self, request: Request, response: bytes | None) -> None:
        """Take the device's response to a client's request."""


class MirroredDevice(Protocol):
    """The device behind a mirror. `holes` are those that it has refused."""

    @property
    def holes(self) -> Holes:
        """See above."""

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Take a request; if it `yields`, requests of clients are sent first."""

    def is_resting(self, now: float) -> bool:
        """Tell whether it is in a back-off after failures."""


class PolledRange:
    """A polled range of addresses, perhaps one of the parts of a `split`. Its values are unknown at first."""

    def __init__(self, poll: Poll, due_at: float, split: Split | None = None) -> None:
        self.poll = poll
        self.due_at = due_at
        self.split = split
        self.runs = poll.runs
        #: Whether its poll is in progress; whether reads wait for it while the values are unknown; whether the device
        #: has refused it.
        self.is_asked = False
        self.is_awaited = True
        self.is_refused = False
        self._asked_at = 0.0
        self._sampled_at: float | None = None
        # Numbers of finished writes: when the present poll was submitted, when the last answered one was, and up to the
        # last write that may have changed the values.
        self._asked_after = 0
        self._sampled_after = 0
        self._changed_by = 0

    @property
    def span(self) -> Span:
        """Its addresses."""
        return self.poll.span

    def asked(self, now: float, writes: int) -> None:
        """Note that its poll is in progress."""
        self.is_asked, self._asked_at, self._asked_after = True, now, writes

    def answered(self) -> None:
        """Note that its poll was answered: the age of the values counts from its submission."""
        self.is_asked = self.is_refused = False
        self._sampled_at, self._sampled_after = self._asked_at, self._asked_after
        if self.split is not None:
            self.split.part_was_read()
            self.split = None

    def failed(self) -> None:
        """Note that its poll was not answered, or not sent: reads do not wait for the next one."""
        self.is_asked = self.is_awaited = False

    def changed(self, now: float, writes: int) -> None:
        """Forget its values, which the last write may have changed. Its next poll is due."""
        self._changed_by = writes
        self.is_awaited = True
        self.due_at = now

    def touches(self, span: Span | None) -> bool:
        """Tell whether it contains an address of `span`; None means every address."""
        return span is None or any(run.touches(span) for run in self.runs)

    def is_known(self, writes: int) -> bool:
        """Tell whether its values include the first `writes` writes."""
        return self._sampled_at is not None and self._sampled_after >= min(self._changed_by, writes)

    def is_lost(self, now: float, stale: float, writes: int) -> bool:
        """Tell whether its values are stale at `now`, or unknown and no poll is in progress."""
        if self._sampled_at is None or not self.is_known(writes):
            return not self.is_awaited
        return now - self._sampled_at > stale

    def age(self, now: float) -> float | None:
        """Return the age of its values in seconds; None while they are unknown."""
        if self._sampled_at is None or not self.is_known(self._changed_by):
            return None
        return now - self._sampled_at


class Polling:
    """Polls `device` for `poller`. `writes` is the number of finished writes to the device."""

    def __init__(
        self, settings: MirrorSettings, counts: MirrorCounts, device: MirroredDevice, poller: MirrorOrigin, emit: Emit
    ) -> None:
        self.writes = 0
        self._settings = settings
        self._counts = counts
        self._device = device
        self._poller = poller
        self._emit = emit
        self._tables = make_tables(settings.areas, {})
        #: Tables have no registers of four bytes.
        polls = [poll for poll in settings.polls if not settings.profile.has_wide(poll.span)]
        ranges = joined(polls, ReadRules.of(settings.profile), device.holes)
        self._ranges = [PolledRange(poll, due_at=0.0) for poll in ranges]
        self._polls: dict[Request, PolledRange] = {}

    def has(self, span: Span) -> bool:
        """Tell whether all of `span` is polled."""
        return self._tables[span.area].has(span)

    def touched(self, span: Span | None) -> list[PolledRange]:
        """Return the ranges that contain an address of `span`; None means every address."""
        return [polled for polled in self._ranges if polled.touches(span)]

    def read(self, span: Span) -> bytes:
        """Return the items of `span`, encoded as in a response."""
        return self._tables[span.area].read(span)

    def changed(self, span: Span | None, now: float) -> None:
        """Note that a write to `span` has finished (None: every address). All ranges are polled again soon."""
        self.writes += 1
        for polled in self._ranges:
            polled.due_at = min(polled.due_at, now)
        for polled in self.touched(span):
            polled.changed(now, self.writes)

    def polled(self, poll: Request, response: bytes | None, now: float) -> None:
        """Take the response to a poll; None if it has none."""
        polled = self._polls.pop(poll)
        if response is None or response[0] & EXCEPTION_BIT:
            self._failed(polled, response, now)
        else:
            self._keep(polled, response)
            polled.answered()

    def deadline(self) -> float | None:
        """Return when to call `tick`; None while nothing more can be polled."""
        if len(self._polls) >= MOST_POLLS:
            return None
        return min((polled.due_at for polled in self._ranges if not polled.is_asked), default=None)

    def tick(self, now: float) -> None:
        """Send the polls that are due, the oldest first. A device in its back-off is not polled."""
        due = [polled for polled in self._ranges if not polled.is_asked and polled.due_at <= now]
        due = sorted(due, key=lambda polled: polled.due_at)[: MOST_POLLS - len(self._polls)]
        is_resting = self._device.is_resting(now)
        for polled in due:
            polled.due_at = now + polled.poll.every
        for polled in due:
            if is_resting:
                polled.failed()
            else:
                self._ask(polled, now)

    def ages(self, now: float) -> Iterator[tuple[Poll, float | None]]:
        """Yield the polls with the age of their values in seconds; None while they are unknown."""
        return ((polled.poll, polled.age(now)) for polled in self._ranges)

    def _keep(self, polled: PolledRange, response: bytes) -> None:
        """Keep the values of a response, without those between its ranges: another poll may have newer ones of them."""
        span, table = polled.span, self._tables[polled.span.area]
        if len(polled.runs) == 1:
            table.write(span, response[2:])
            return
        items = items_read(span, response)
        size = len(items) // span.count
        for run in polled.runs:
            own = items[(run.start - span.start) * size : (run.end - span.start) * size]
            table.write(run, pack_bits(own) if has_bits(run.area) else own)

    def _ask(self, polled: PolledRange, now: float) -> None:
        poll = Request(self._settings.unit, polled.poll.request, self._poller, now)
        polled.asked(now, self.writes)
        self._counts.polls += 1
        self._polls[poll] = polled
        self._device.submit(poll, now, yields=True)

    def _failed(self, polled: PolledRange, response: bytes | None, now: float) -> None:
        self._counts.failed_polls += 1
        polled.failed()
        if response is not None and response[1] == PathUnavailable.code:
            polled.due_at = now + UNSENT_PAUSE
        if response is not None and response[1] == Busy.code:
            polled.due_at = max(polled.due_at, now + UNSENT_PAUSE)
        if response is None or response[1] not in _REFUSALS:
            return
        parts, hole = polled.poll.parts, polled.poll.hole
        if parts:
            at = self._ranges.index(polled)
            split = None if hole is None else Split(hole, self._device.holes, polled.split)
            self._ranges[at : at + 1] = [PolledRange(part, now, split) for part in parts]
        else:
            polled.split = None  # what becomes readable later tells nothing of a hole
            self._refused(polled, response[1])

    def _refused(self, polled: PolledRange, code: int) -> None:
        """Log a refusal once, until the device answers again."""
        if not polled.is_refused:
            polled.is_refused = True
            settings = self._settings
            self._emit(PollRefused(settings.name, settings.of, str(polled.poll), code, settings.source))
