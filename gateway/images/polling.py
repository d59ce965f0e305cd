"""Polls a device for all that want its values: mirrors, virtual units and what is published.

    unknown ──poll answered──▶ fresh ──older than `stale`──▶ stale
       ▲                         │                             │
       └──── a write finished ───┴─────────────────────────────┘

What a reader wants is a part; parts with the same interval are joined into as few requests as the device allows. The
age of a part counts from the submission of its poll, so its values are never older than that.

Order is counted in writes: `writes` is the number of finished writes to the device. The response to a poll includes all
writes that had finished when the poll was submitted. It may lack later ones, because several requests can be on the way
to the device.

It has no clock: time is an argument, and `deadline` says when to call `tick`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Final, Protocol

from gateway.errors import (
    Busy,
    DeviceFailure,
    IllegalAddress,
    IllegalValue,
    LineDown,
    NoResponse,
)
from gateway.events import Emit, PollRefused
from gateway.images.due import Due
from gateway.images.polled_range import Part, PolledRange
from gateway.images.polls import Poll, joined
from gateway.images.supply import Supply
from gateway.images.turns import PollTurns
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes, Split
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import items_read
from gateway.request import Origin, Request

#: Exceptions that refuse a range as a whole: address, quantity, and 04, which some devices send instead.
_REFUSALS: Final = frozenset({IllegalAddress.code, IllegalValue.code, DeviceFailure.code})
#: Exceptions of a gateway that does not reach the unit, or gets no answer from it.
_NO_ANSWER: Final = frozenset({LineDown.code, NoResponse.code})
#: The pause before repeating a poll that was not sent, or that the device is too busy for, in seconds.
UNSENT_PAUSE: Final = 0.25
#: The longest pause before repeating a poll while the line is down, in seconds.
DOWN_PAUSE: Final = 1.0
#: After a poll without an answer the next one comes no later than this, in seconds.
RETRY: Final = 5.0
#: After this many seconds parts that are read apart are tried together again, unless that is known to be refused.
TOGETHER_AGAIN: Final = 60.0
#: So many polls are sent before the event loop goes on; clients wait for no more.
MOST_AT_ONCE: Final = 64


class PolledTarget(Protocol):
    """What is polled. `holes` are those that it has refused."""

    @property
    def holes(self) -> Holes:
        """See above."""

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Take a request; if it `yields`, requests of clients are sent first."""

    def is_resting(self, now: float) -> bool:
        """Tell whether it is in a back-off after failures."""


@dataclass(frozen=True, slots=True)
class PolledUnit:
    """What is polled: a device named `name`, `unit` in logs and the trace, and what one read of it may take.

    What has `many_sources`, a virtual unit, is read value by value, and is there though one of them has no answer.
    """

    name: str
    unit: int
    rules: ReadRules
    many_sources: bool = False


class DevicePolls(Supply):
    """Polls `target` as `origin` for readers. Its polls wait in `turns`, which the devices of a line share."""

    silence = "has not answered for too long"

    def __init__(self, unit: PolledUnit, target: PolledTarget, origin: Origin, turns: PollTurns, emit: Emit) -> None:
        super().__init__()
        self.unit = unit
        self._target = target
        self._origin = origin
        self._turns = turns
        self._emit = emit
        self._ranges: dict[PolledRange, None] = {}
        self._due = Due()
        self._written_at = 0.0
        self._polls: dict[Request, PolledRange] = {}

    def change(self, come: Iterable[Part], gone: Iterable[Part], now: float) -> None:
        """Poll for the parts that `come`, at once, and no more for those that are `gone`.

        All others keep their values, and their intervals as well as they can. A request that stays the same goes on.
        """
        come = tuple(come)
        for part in come:
            if part.sampled_at is None:
                part.changed(self.writes)  # a poll that was sent before a write finished tells it nothing
        self._supply(come, gone)
        by_poll: dict[Poll, list[Part]] = {}
        for part in self._parts:
            by_poll.setdefault(part.poll, []).append(part)
        due = {
            poll: now if each.is_asked else self._due_since(each) for each in self._ranges for poll in each.poll.wanted
        }
        halves = {half for each in self._ranges for half in each.halves}
        before = {each.poll: each for each in self._ranges if each not in halves}
        unit = self.unit
        for poll in by_poll if unit.many_sources else joined(by_poll, unit.rules, self._target.holes):
            parts = [part for wanted in poll.wanted for part in by_poll[wanted]]
            if (same := before.pop(poll, None)) is not None:
                same.serve(parts)
            else:
                self._add(PolledRange(poll, parts, min(due.get(wanted, now) for wanted in poll.wanted)))
        for old in before.values():
            self._end_halves(old)
            self._end(old)
        for polled in self._ranges:
            if polled.is_urgent and polled.due_at > now:
                self._due.plan(polled, now)

    def changed(self, span: Span | None, now: float) -> None:
        """Note that a write to `span` has finished (None: every address); the values there are unknown until polled.

        It may have changed others too, so everything is polled again at once; for what was written others on the line
        are not waited for, as a client's reads wait.
        """
        changed = self._forget(span)
        self._written_at = now
        self._due.all_due(now)
        for polled in {part.polled_by: None for part in changed if part.sampled_at is not None}:
            if polled is not None:
                if polled.is_waiting:
                    polled.is_asked = polled.is_waiting = False
                self._due.plan(polled, min(polled.due_at, now))

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting poll should be sent: not one that is sent in another way now."""
        polled = self._polls.get(request)
        return polled is not None and not polled.is_over

    def polled(self, poll: Request, response: bytes | None, now: float) -> None:
        """Take the response to a poll; None if it has none."""
        polled = self._polls.pop(poll)
        polled.is_asked = False
        self._due.plan(polled, self._due_since(polled))
        try:
            if response is not None and not response[0] & EXCEPTION_BIT and self._take(polled, response, now):
                self._accepted(polled, now)
            else:
                self._failed(polled, poll, response, now)
            self._settle(polled, now)
        finally:
            self._turns.leave(now)

    def deadline(self) -> float | None:
        """Return when to call `tick`; None if there is nothing to poll."""
        return self._due.deadline()

    def tick(self, now: float) -> None:
        """Send polls that are due, the oldest first; if there are more, `deadline` says so.

        A device in its back-off is not polled.
        """
        for _ in range(MOST_AT_ONCE):
            deadline = self.deadline()
            if deadline is None or deadline > now:
                return
            due = self._due.take(now)
            if due is not None:
                self._begin(due[1], due[0], now)

    def _begin(self, polled: PolledRange, due: float, now: float) -> None:
        """Let a poll that is `due` take its turn."""
        if polled.split is not None and not polled.split.unread:
            self._end(polled)
            return
        interval = max(polled.poll.every, TOGETHER_AGAIN) if polled.halves else polled.poll.every
        next_due = due + interval * max(1, ceil((now - due) / interval))
        if self._target.is_resting(now):
            self._due.plan(polled, next_due)
            polled.missed(now, answers=False)
            self._settle(polled, now)
            return
        polled.is_asked = polled.is_waiting = True
        polled.due_at = next_due
        send, overdue = partial(self._send, polled), partial(self._wait_no_longer, polled)
        self._turns.enter(send, overdue, now, at_once=polled.is_written)

    def _send(self, polled: PolledRange, now: float) -> None:
        """Send a poll whose turn it is, unless it was sent at once meanwhile."""
        if polled.is_over or not polled.is_waiting:
            self._turns.leave(now)
            return
        polled.is_waiting = False
        request = Request(self.unit.unit, polled.poll.request, self._origin, now)
        polled.asked(now, self.writes)
        self._polls[request] = polled
        try:
            self._target.submit(request, now, yields=True)
        except BaseException:
            if not request.is_over:
                request.fail(DeviceFailure())
            raise

    def _wait_no_longer(self, polled: PolledRange, now: float) -> None:
        """End the waiting of reads for a poll that has no turn yet."""
        if polled.is_waiting and not polled.is_over:
            polled.missed(now, answers=None)
            self._settle(polled, now)

    def _due_since(self, polled: PolledRange) -> float:
        """Return when a range is due: since the last write if its poll was sent before; one with halves in its time."""
        is_before_write = polled.asked_after < self.writes and not polled.halves
        return min(polled.due_at, self._written_at) if is_before_write else polled.due_at

    def _add(self, polled: PolledRange) -> None:
        self._ranges[polled] = None
        self._due.plan(polled, polled.due_at)

    def _take(self, polled: PolledRange, response: bytes, now: float) -> bool:
        """Hand the items of a response to their readers. Return False if it has another length."""
        try:
            items = items_read(polled.poll.span, response, polled.poll.width)
        except ValueError:
            return False
        polled.take(items, now)
        return True

    def _accepted(self, polled: PolledRange, now: float) -> None:
        """Note a response: if its parts were read apart, they are read together again."""
        if polled.is_over:
            return
        polled.is_refused = False
        if polled.within is not None:
            polled.within.part_was_read()
            polled.within = None
        if polled.halves:
            self._end_halves(polled)  # perhaps before they were polled again after a write
            polled.serve(polled.parts)
            self._due.plan(polled, now if polled.is_urgent else now + polled.poll.every)

    def _failed(self, polled: PolledRange, poll: Request, response: bytes | None, now: float) -> None:
        if polled.is_over:  # its parts are read in another way now
            return
        code = 0 if response is None else response[1]
        has_answered = response is not None and (code not in _NO_ANSWER or self.unit.many_sources)
        answers = None if isinstance(poll.error, Busy) else has_answered
        polled.missed(now, answers=answers, was_sent=True)
        if code == LineDown.code:
            self._due.plan(polled, now + max(UNSENT_PAUSE, min(polled.poll.every, DOWN_PAUSE)))
        elif not answers or code == Busy.code:
            self._due.plan(polled, max(now + UNSENT_PAUSE, min(polled.due_at, now + RETRY)))
        elif code in _REFUSALS and not polled.is_refused:
            self._refused(polled, code, now)

    def _refused(self, polled: PolledRange, code: int, now: float) -> None:
        """Split a range until it is answered. One that cannot be split is logged."""
        polled.is_refused = True
        poll, within = polled.poll, polled.within
        polled.within = None  # what becomes readable later tells nothing of a hole
        if not poll.joined:
            self._log_refusal(polled, code)
        if poll.hole is not None:
            polled.split = Split(poll.hole, self._target.holes, within)
        for part in poll.parts:
            half = polled.half(part, now)
            self._add(half)
        if polled.halves:
            self._due.plan(polled, now + max(poll.every, TOGETHER_AGAIN))

    def _log_refusal(self, polled: PolledRange, code: int) -> None:
        reader = polled.parts[0].reader
        self._emit(PollRefused(reader.label, self.unit.name, str(polled.poll), code, reader.place))

    def _end_halves(self, polled: PolledRange) -> None:
        """End all halves of a range, and theirs."""
        for half in polled.halves:
            self._end_halves(half)
            self._end(half)
        polled.halves.clear()
        polled.split = None

    def _end(self, polled: PolledRange) -> None:
        """Send this poll no more. Its halves go on."""
        polled.is_over = True
        self._ranges.pop(polled, None)

    def _settle(self, polled: PolledRange, now: float) -> None:
        for reader in polled.readers:
            reader.settle(polled.parts, now)
