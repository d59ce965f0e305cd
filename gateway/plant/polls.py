"""Reads the published points: each batch at its interval, through the queue of its line.

It has no clock: time is an argument, and `deadline` says when `tick` must be called again.
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count
from math import ceil
from typing import Final, NamedTuple, Protocol

from gateway.errors import Busy, IllegalDataAddress, IllegalDataValue, PathUnavailable, TargetFailedToRespond
from gateway.events import Emit, PollRefused
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span
from gateway.profiles.batches import Batch
from gateway.profiles.holes import Holes, Split
from gateway.profiles.published import PublishedDevice, timed_batches
from gateway.registers.datatypes import Value
from gateway.request import Origin, Request

#: The most reads in progress or waiting at a line. More would only fill its queue.
MOST_READS: Final = 16
#: After a read that got no response the next one comes no later than this, in seconds.
RETRY: Final = 5.0
#: Exceptions by which devices refuse a range: address and quantity.
_REFUSALS: Final = frozenset({IllegalDataAddress.code, IllegalDataValue.code})
#: The exception for a failure of the device. Some devices send it for addresses that they do not have: it counts as a
#: refusal after this many in a row.
_FAILURE: Final = 4
_FAILURES_OF_REFUSAL: Final = 3
#: After this many seconds points that are read apart are tried together again, unless that is known to be refused.
TOGETHER_AGAIN: Final = 60.0
#: Exceptions of a gateway that does not reach the unit, or gets no answer from it.
_NO_ANSWER: Final = frozenset({PathUnavailable.code, TargetFailedToRespond.code})


class PolledTarget(Protocol):
    """The target that answers for a published device. `holes` are those that it has refused."""

    @property
    def holes(self) -> Holes:
        """See above."""

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        """Take a request; with `yields`, requests of clients are sent first."""

    def is_resting(self, now: float) -> bool:
        """Tell whether it backs off after failures."""


class Answer(NamedTuple):
    """The outcome of a read: the values of its points by name; none if it failed.

    `answers` tells whether the device answers; it is None if it was not asked, because its line is busy.
    """

    device: PublishedDevice
    values: Mapping[str, Value | None]
    answers: bool | None


@dataclass(slots=True)
class PollCounts:
    """Reads that were sent to the queues of lines, that failed, and that were skipped: the one before was not over."""

    polls: int = 0
    failed: int = 0
    skipped: int = 0


@dataclass(slots=True, eq=False)
class _Read:
    """A request that repeats, and when it is due. `is_asked`: it waits here or at the line, or is in progress.

    While it is refused, `parts` read its points. If they are the two sides of a hole they are parts of its `split`, and
    it is needed no more once that is settled. `is_over`: it is not needed any more. `part_of` is the split of which it
    is a part that was not read yet.
    """

    device: PublishedDevice
    every: float
    batch: Batch
    due_at: float
    part_of: Split | None = None
    is_asked: bool = False
    is_refused: bool = False
    is_over: bool = False
    failures: int = 0
    parts: list["_Read"] = field(default_factory=list)
    split: Split | None = None
    pdu: bytes = field(init=False)

    def __post_init__(self) -> None:
        self.pdu = self.batch.request

    @property
    def interval(self) -> float:
        """The number of seconds after which it is due again."""
        return max(self.every, TOGETHER_AGAIN) if self.parts else self.every


class _Line:
    """The reads of one line: few at once, the others are `waiting`. `is_passing` while they are passed to the line."""

    def __init__(self) -> None:
        self.in_progress = 0
        self.is_passing = False
        self.waiting: deque[_Read] = deque()


class Polls:
    """Reads the points of `devices` from their `targets`, by names of devices, as requests of `origin`.

    `source` is the place of the table in the config.
    """

    def __init__(
        self,
        devices: Sequence[PublishedDevice],
        targets: Mapping[str, PolledTarget],
        origin: Origin,
        emit: Emit,
        source: str,
        now: float,
    ) -> None:
        self.counts = PollCounts()
        self._targets = targets
        self._origin = origin
        self._emit = emit
        self._source = source
        self._lines: dict[str, _Line] = {device.line: _Line() for device in devices}
        self._reads: dict[str, list[_Read]] = {device.name: [] for device in devices}
        self._due: list[tuple[float, int, _Read]] = []
        self._number = count()
        self._asked: dict[Request, _Read] = {}
        for device in devices:
            self._add(
                _Read(device, every, batch, now) for every, batch in timed_batches(device, targets[device.name].holes)
            )

    def deadline(self) -> float | None:
        """Return when `tick` must be called; None if there is nothing to read."""
        while self._due and self._due[0][0] != self._due[0][2].due_at:
            heappop(self._due)
        return self._due[0][0] if self._due else None

    def tick(self, now: float) -> list[Answer]:
        """Send the reads that are due. Return those that failed at once, because their device backs off."""
        failed = []
        while (due := self.deadline()) is not None and due <= now:
            read = heappop(self._due)[2]
            if read.split is not None and not read.split.unread:
                self._end(read)
                continue
            missed = max(1, ceil((now - due) / read.interval))
            self._plan(read, due + read.interval * missed)
            if read.is_asked:
                self.counts.skipped += 1
            elif self._targets[read.device.name].is_resting(now):
                failed.append(Answer(read.device, {}, answers=False))
            else:
                read.is_asked = True
                line = self._lines[read.device.line]
                line.waiting.append(read)
                self._go_on(line, now)
        return failed

    def answered(self, request: Request, response: bytes | None, now: float) -> Answer:
        """Take the response to a read, None if there was none; return the outcome."""
        read = self._asked.pop(request)
        read.is_asked = False
        line = self._lines[read.device.line]
        line.in_progress -= 1
        answer = self._answer(read, request, response, now)
        self._go_on(line, now)
        return answer

    def has(self, request: Request) -> bool:
        """Tell whether `request` is one of these reads."""
        return request in self._asked

    def read_soon(self, device: str, spans: Sequence[Span], now: float) -> None:
        """Make the reads of `spans` due at once: something was written."""
        for read in self._reads[device]:
            if not read.parts and any(read.batch.span.touches(span) for span in spans):
                self._plan(read, now)

    def _add(self, reads: Iterable[_Read]) -> None:
        for read in reads:
            self._reads[read.device.name].append(read)
            self._plan(read, read.due_at)

    def _plan(self, read: _Read, due_at: float) -> None:
        if read.is_over:
            return
        read.due_at = due_at
        heappush(self._due, (due_at, next(self._number), read))

    def _go_on(self, line: _Line, now: float) -> None:
        """Pass waiting reads to their line. An answer may come before `submit` returns; then this loop goes on."""
        if line.is_passing:
            return
        line.is_passing = True
        try:
            while line.waiting and line.in_progress < MOST_READS:
                self._submit(line, line.waiting.popleft(), now)
        finally:
            line.is_passing = False

    def _submit(self, line: _Line, read: _Read, now: float) -> None:
        request = Request(read.device.told_unit, read.pdu, self._origin, now)
        self._asked[request] = read
        line.in_progress += 1
        self.counts.polls += 1
        self._targets[read.device.name].submit(request, now, yields=True)

    def _answer(self, read: _Read, request: Request, response: bytes | None, now: float) -> Answer:
        if response is not None and not response[0] & EXCEPTION_BIT:
            try:
                values = {point.name: point.value(items) for point, items in read.batch.items_read(response)}
            except ValueError:
                response = None
            else:
                self._accepted(read, now)
                return Answer(read.device, values, answers=True)
        self.counts.failed += 1
        code = 0 if response is None else response[1]
        if isinstance(request.error, Busy):
            self._plan(read, min(read.due_at, now + RETRY))
            return Answer(read.device, {}, answers=None)
        if response is None or code in _NO_ANSWER:
            self._plan(read, min(read.due_at, now + RETRY))
            return Answer(read.device, {}, answers=False)
        read.failures = read.failures + 1 if code == _FAILURE else 0
        if code in _REFUSALS or read.failures >= _FAILURES_OF_REFUSAL:
            self._refused(read, code, now)
        return Answer(read.device, {}, answers=True)

    def _accepted(self, read: _Read, now: float) -> None:
        """Note a response: if its points were read apart, they are read together again."""
        if read.is_over:
            return
        read.is_refused, read.failures = False, 0
        if read.part_of is not None:
            read.part_of.part_was_read()
            read.part_of = None
        if read.parts:
            self._plan(read, now + read.every)
            self._end_parts(read)

    def _end_parts(self, read: _Read) -> None:
        """End all parts of a read, and their parts."""
        for part in read.parts:
            self._end_parts(part)
            self._end(part)
        read.parts.clear()
        read.split = None

    def _end(self, read: _Read) -> None:
        """Send this read no more. Its parts go on."""
        if not read.is_over:
            self._reads[read.device.name].remove(read)
            read.is_over, read.due_at = True, -1.0  # its entry in the heap counts no more

    def _refused(self, read: _Read, code: int, now: float) -> None:
        """Split a read until it is answered. Log the first refusal, unless it may be due to the addresses between."""
        if read.is_refused or read.is_over:
            return
        read.is_refused = True
        batch, within = read.batch, read.part_of
        read.part_of = None  # what becomes readable later tells nothing of a hole
        if batch.hole is None:
            what = f"{batch.span.area} {batch.span.addresses}"
            self._emit(PollRefused(self._origin.caller.client, read.device.name, what, code, self._source))
        else:
            read.split = Split(batch.hole, self._targets[read.device.name].holes, within)
        read.parts = [_Read(read.device, read.every, part, now, read.split) for part in batch.parts]
        if read.parts:
            self._add(read.parts)
            self._plan(read, now + read.interval)
