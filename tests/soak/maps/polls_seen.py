"""Which polls were sent and answered, and which writes have finished: what is fresh, as seen beside the gateway.

with PollsSeen() as seen:
    bench = GatewayBench(config)
seen.of_device["meter-1"]
"""

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from math import inf
from typing import Any, Final, Self
from unittest.mock import patch

from gateway.images.drivers.polls_driver import PollsDriver
from gateway.images.drivers.unit_driver import UnitDriver
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.pdu import Span, parse_request
from gateway.registers.items import unpack_bits
from gateway.request import Target
from soak.maps.devices import POINTS, Told
from soak.maps.rows import BITS, Row

#: What happens at the same moment may be on either side of it, in seconds.
A_MOMENT: Final = 1e-6
#: So many polls and writes of a device are remembered: more than in any `stale`, and in any time that it is dead.
_REMEMBERED: Final = 1000
#: So many rows are looked up without seeking: more than the maps of a moment have of one device.
_ROWS: Final = 50
#: Longer than rows are read apart after they were refused together, in seconds.
_APART: Final = 100.0


@dataclass
class PollSeen:
    """A poll, the items that it has read, at their places in the area, and when it was answered, rightly."""

    span: Span
    submitted_at: float
    answered_at: float = -1.0
    told: Told | None = None

    def shows(self, row: Row) -> tuple[int, ...] | None:
        """What a row shows of it."""
        return None if self.told is None else row.shown(self.told)


@dataclass
class WriteSeen:
    """A write that has finished, and whether it was done for certain."""

    span: Span
    finished_at: float
    is_done: bool


class DeviceSeen:
    """The polls of a device and the writes to it, in their order."""

    def __init__(self) -> None:
        self.polls: deque[PollSeen] = deque(maxlen=_REMEMBERED)
        self.writes: deque[WriteSeen] = deque(maxlen=_REMEMBERED)
        self._open: dict[Any, PollSeen] = {}
        #: When these addresses were polled last, whether or not that was answered.
        self._asked_at: dict[Span, float] = {}
        #: The latest polls that have read each row, found when it is asked for.
        self._of_row: dict[Row, deque[PollSeen]] = {}

    def submitted(self, request: Any, now: float) -> None:
        """A poll is sent."""
        span = parse_request(request.pdu).read
        assert span is not None
        self._open[request] = PollSeen(span, now)
        self._asked_at[span] = now

    def answered(self, request: Any, response: bytes | None, now: float) -> None:
        """A poll is over."""
        poll = self._open.pop(request)
        if response is not None and not response[0] & EXCEPTION_BIT:
            poll.answered_at = now
            poll.told = Told(now, (0,) * poll.span.start + _items(poll.span, response))
            self.polls.append(poll)
            for row, polls in self._of_row.items():
                if _reads(poll, row):
                    polls.append(poll)

    def of_row(self, row: Row, since: float, until: float) -> Iterator[PollSeen]:
        """The polls that have read a row, submitted and answered in this time, the last answer first."""
        polls = self._of_row.get(row)
        if polls is None:
            if len(self._of_row) >= _ROWS:
                self._of_row.clear()
            polls = self._of_row[row] = deque((each for each in self.polls if _reads(each, row)), maxlen=_REMEMBERED)
        for poll in reversed(polls):
            if poll.answered_at < since:
                break
            if poll.submitted_at >= since and poll.answered_at <= until:
                yield poll

    def is_surely_fresh(self, row: Row, stale: float, settled_at: float, now: float) -> bool:
        """Whether the gateway must have a fresh value, known since all was `settled`."""
        polls = list(self.of_row(row, max(settled_at, now - stale - A_MOMENT), now + A_MOMENT))
        sure = [poll for poll in polls if poll.answered_at <= now - A_MOMENT and self._is_for(row, poll, now)]
        if not sure:
            return False
        newest = max(poll.submitted_at for poll in sure)
        if now + A_MOMENT - newest > stale or self._may_have_changed(row, newest - A_MOMENT, now):
            return False
        return all(poll.shows(row) is not None for poll in polls if poll.submitted_at >= newest - A_MOMENT)

    def is_surely_stale(self, row: Row, stale: float, asked_at: float, now: float) -> bool:
        """Whether the gateway cannot have a fresh value for a client that has asked then."""
        since = 0.0
        for write in reversed(self.writes):
            if write.finished_at < now - stale:
                break
            if write.is_done and write.finished_at < asked_at and _changes(write, row):
                since = write.finished_at
                break
        polls = list(self.of_row(row, max(since, now - stale) - A_MOMENT, now + A_MOMENT))
        return not any(poll.shows(row) is not None for poll in polls)

    def held(self, row: Row, settled_at: float, now: float) -> PollSeen | None:
        """The last poll whose value the gateway must have kept."""
        newest = None
        for poll in self.of_row(row, settled_at, now - A_MOMENT):
            if newest is not None and poll.answered_at < newest.submitted_at:
                break
            is_newer = newest is None or poll.submitted_at > newest.submitted_at
            if is_newer and poll.shows(row) is not None and self._is_for(row, poll, now):
                newest = poll
        return newest

    def _is_for(self, row: Row, poll: PollSeen, now: float) -> bool:
        """Whether the gateway takes the value of a row out of this poll, and not out of one for the row alone."""
        alone = Span(row.source.area, row.source.first, row.source.count)
        return poll.span == alone or self._asked_at.get(alone, -inf) < now - _APART

    def _may_have_changed(self, row: Row, since: float, until: float) -> bool:
        for write in reversed(self.writes):
            if write.finished_at < since:
                return False
            if write.finished_at <= until + A_MOMENT and _may_change(write, row):
                return True
        return False


class PollsSeen:
    """Sees the polls of gateways that are built while it is entered."""

    def __init__(self) -> None:
        #: By the names of devices: those whose polls were made last.
        self.of_device: dict[str, DeviceSeen] = {}
        self._of_polls: dict[Any, DeviceSeen] = {}
        self._patches = ExitStack()

    def __enter__(self) -> Self:
        place = "gateway.images.drivers.polls_driver.PollsDriver"
        self._patches.enter_context(patch(place, lambda *arguments: _SeenDriver(self, *arguments)))
        passed = UnitDriver.passed

        def note_and_pass(driver: Any, request: Any, polls: Any, sent: Any, response: bytes | None) -> None:
            self._wrote(polls, sent, response, driver._time())
            passed(driver, request, polls, sent, response)

        self._patches.enter_context(patch.object(UnitDriver, "passed", note_and_pass))
        return self

    def __exit__(self, *_: object) -> None:
        self._patches.close()

    def add(self, name: str, polls: Any) -> DeviceSeen:
        """Polls of a device with this name were made."""
        seen = self._of_polls[polls] = self.of_device[name] = DeviceSeen()
        return seen

    def _wrote(self, polls: Any, sent: Any, response: bytes | None, now: float) -> None:
        span = parse_request(sent.pdu).write
        if span is not None and polls in self._of_polls:
            is_done = response is not None and not response[0] & EXCEPTION_BIT
            self._of_polls[polls].writes.append(WriteSeen(span, now, is_done))


class _SeenDriver(PollsDriver):
    """A driver of polls that tells of them."""

    def __init__(self, by: PollsSeen, unit: Any, target: Any, *others: Any) -> None:
        super().__init__(unit, _SeenTarget(target), *others)
        self.target.seen = self.seen = by.add(unit.name, self.polls)

    def answer(self, request: Any, pdu: bytes | None) -> None:
        self.seen.answered(request, pdu, self._time())
        super().answer(request, pdu)


class _SeenTarget(Target):
    """What is polled, and who is told of it."""

    seen: DeviceSeen

    def __init__(self, target: Any) -> None:
        self._target = target
        self.is_resting = target.is_resting

    @property
    def holes(self) -> Any:
        return self._target.holes

    def submit(self, request: Any, now: float, *, yields: bool = False) -> None:
        self.seen.submitted(request, now)
        self._target.submit(request, now, yields=yields)


def _items(span: Span, response: bytes) -> tuple[int, ...]:
    if span.area in BITS:
        return tuple(unpack_bits(response[2:], span.count))
    return tuple(int.from_bytes(response[at : at + 2]) for at in range(2, len(response), 2))


def _reads(poll: PollSeen, row: Row) -> bool:
    span, source = poll.span, row.source
    return span.area is source.area and span.start <= source.first and source.first + source.count <= span.end


def _changes(write: WriteSeen, row: Row) -> bool:
    span, source = write.span, row.source
    return span.area is source.area and span.start < source.first + source.count and source.first < span.end


def _may_change(write: WriteSeen, row: Row) -> bool:
    """Whether a write is to the addresses of a row, or to where a point is written that has one of them."""
    if _changes(write, row):
        return True
    read = range(row.source.first, row.source.first + row.source.count)
    return any(
        point.area is row.source.area is write.span.area
        and write.span.start <= point.written_at < write.span.end
        and point.first in read
        for point in POINTS.values()
    )
