"""How a mirror asks its device, and what it knows of it: the values of its last polls, range by range.

A value's age counts from when its poll was handed to the line, so it is never older than it seems.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

from gateway.errors import Busy, PathUnavailable
from gateway.events import Emit, PollRefused
from gateway.images.polled_range import PolledRange
from gateway.images.polls import MirrorSettings, Poll, joined
from gateway.images.tables import make_tables
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span
from gateway.request import Origin, Request

#: Exceptions by which devices refuse a range as a whole: address, quantity, and what some answer instead.
_REFUSALS: Final = frozenset({2, 3, 4})
#: How long until a poll is tried again that was not sent, because the line has no port or is busy; in seconds.
UNSENT_PAUSE: Final = 0.25
#: So many polls of a mirror are in progress or wait. More would only take the places of clients.
MOST_POLLS: Final = 16


@dataclass(slots=True)
class Counts:
    """What a mirror has done."""

    requests: int = 0
    exceptions: int = 0
    polls: int = 0
    failed_polls: int = 0


class Poller(Origin, Protocol):
    """Who sends a mirror's polls and gets their answers, and those to the requests that pass through."""

    def passed(self, request: Request, response: bytes | None) -> None:
        """Take the device's answer to a client's request."""


class MirroredDevice(Protocol):
    """The device behind a mirror."""

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Take over a request; one that `yields` lets the requests of clients go first."""

    def is_resting(self, now: float) -> bool:
        """Whether it has failed too often and is left alone."""


class Polling:
    """Polls `device` in the name of `poller`. `writes` is how many writes to the device have ended so far."""

    def __init__(
        self, settings: MirrorSettings, counts: Counts, device: MirroredDevice, poller: Poller, emit: Emit
    ) -> None:
        self.writes = 0
        self._settings = settings
        self._counts = counts
        self._device = device
        self._poller = poller
        self._emit = emit
        self._tables = make_tables(settings.areas, {})
        self._ranges = [PolledRange(poll, due_at=0.0) for poll in joined(settings.polls, settings.profile.limits)]
        self._polls: dict[Request, PolledRange] = {}

    def has(self, span: Span) -> bool:
        """Whether all of `span` is polled."""
        return self._tables[span.area].has(span)

    def touched(self, span: Span | None) -> list[PolledRange]:
        """The ranges that have an address of `span`; None stands for every address."""
        return [polled for polled in self._ranges if polled.touches(span)]

    def read(self, span: Span) -> bytes:
        """The items of `span`, as a response carries them."""
        return self._tables[span.area].read(span)

    def changed(self, span: Span | None, now: float) -> None:
        """A write to `span` has ended; None stands for every address. What else it changed in the device shows soon."""
        self.writes += 1
        for polled in self._ranges:
            polled.due_at = min(polled.due_at, now)
        for polled in self.touched(span):
            polled.changed(now, self.writes)

    def polled(self, poll: Request, response: bytes | None, now: float) -> None:
        """A poll is over; None when it has no response."""
        polled = self._polls.pop(poll)
        if response is None or response[0] & EXCEPTION_BIT:
            self._failed(polled, response, now)
        else:
            self._tables[polled.span.area].write(polled.span, response[2:])
            polled.answered()

    def deadline(self) -> float | None:
        """When `tick` wants to be called; None while no more can be asked for."""
        if len(self._polls) >= MOST_POLLS:
            return None
        return min((polled.due_at for polled in self._ranges if not polled.is_asked), default=None)

    def tick(self, now: float) -> None:
        """Send the polls that are due, the oldest first. A unit that rests is not asked."""
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
        """What is polled, and how old the values are in seconds; None while they are not known."""
        return ((polled.poll, polled.age(now)) for polled in self._ranges)

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
        if polled.poll.parts:
            at = self._ranges.index(polled)
            self._ranges[at : at + 1] = [PolledRange(part, due_at=now) for part in polled.poll.parts]
        else:
            self._refused(polled, response[1])

    def _refused(self, polled: PolledRange, code: int) -> None:
        """A refusal is told once, until the device answers."""
        if not polled.is_refused:
            polled.is_refused = True
            settings = self._settings
            self._emit(PollRefused(settings.name, settings.of, str(polled.poll), code, settings.source))
