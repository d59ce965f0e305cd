"""Polls of a device: what is wanted of it, joined into as few requests as it allows."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes, holes_between, middle_hole
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range
from gateway.profiles.read_rules import ReadRules
from gateway.registers.items import REGISTER, has_bits, read_request

#: The functions that a mirror answers from its polls.
POLLING_FUNCTIONS: Final = frozenset(function for function, _ in READERS.values())


class Poll(NamedTuple):
    """A range of addresses, registers of `width` bytes, that is read with one request every `every` seconds.

    0: once, or whenever others read it and that is heard.

    `joined` are the ranges that it was joined from, in the order of their first addresses; none if it is one that is
    wanted as it is.
    """

    area: Area
    first: int
    last: int
    every: float
    joined: "tuple[Poll, ...]" = ()
    width: int = REGISTER

    @classmethod
    def of(cls, point: Point, every: float = 0.0) -> Self:
        """Make the poll that reads all of a point's `read_span`."""
        span = point.read_span
        return cls(span.area, span.start, span.end - 1, every, width=point.width)

    @property
    def span(self) -> Span:
        """Its addresses."""
        return Span(self.area, self.first, self.last - self.first + 1)

    @property
    def request(self) -> bytes:
        """The request PDU."""
        return read_request(self.span)

    @property
    def wanted(self) -> "tuple[Poll, ...]":
        """The ranges that it reads."""
        return self.joined or (self,)

    def place(self, wanted: "Poll") -> slice:
        """Find the items of one of its ranges among all that it reads."""
        size = 1 if has_bits(self.area) else self.width
        start = (wanted.first - self.first) * size
        return slice(start, start + wanted.span.count * size)

    @property
    def bridged(self) -> int:
        """The number of addresses that are read though no range has them."""
        return sum(hole.count for hole in holes_between(each.span for each in self.wanted))

    @property
    def hole(self) -> Span | None:
        """The hole at which it is split when the device refuses it; None if it has none."""
        return middle_hole(each.span for each in self.wanted)

    @property
    def parts(self) -> "tuple[Poll, ...]":
        """What to read instead when the device refuses it: its two sides of the hole, or its ranges."""
        hole = self.hole
        if hole is None:
            return self.joined
        before = tuple(each for each in self.joined if each.first < hole.start)
        return _together(before), _together(self.joined[len(before) :])

    def __str__(self) -> str:
        return f"{self.area} {self.span.addresses}"


@dataclass(frozen=True, slots=True)
class MirrorSettings:
    """A mirror of the device named `of`, which has `profile`. `areas` are the addresses of all `polls`.

    Values older than `stale` seconds are not sent. What is only heard is kept address by address, but for values that
    are `together`; None: it is polled.
    """

    unit: int
    name: str
    of: str
    profile: Profile
    polls: tuple[Poll, ...]
    areas: Mapping[Area, tuple[Range, ...]]
    stale: float
    source: str = field(default="", compare=False)
    together: tuple[Span, ...] | None = None

    @property
    def label(self) -> str:
        """What logs and the trace call it."""
        return f"mirror {self.name}"

    @property
    def wanted(self) -> tuple[Poll, ...]:
        """What it wants: its polls, without registers of four bytes; none is longer than one request."""
        polls = (poll for poll in self.polls if not self.profile.has_wide(poll.span))
        if self.together is not None:
            return tuple(apart(polls, self.together))
        return tuple(cut(polls, ReadRules.of(self.profile)))


def polling_function(area: Area) -> int:
    """Return the function that reads an area."""
    return READERS[area][0]


def cut(polls: Iterable[Poll], rules: ReadRules) -> Iterator[Poll]:
    """Cut polls that are longer than one request."""
    for poll in polls:
        most = rules.most(poll.area)
        for first in range(poll.first, poll.last + 1, most):
            yield Poll(poll.area, first, min(first + most - 1, poll.last), poll.every)


def apart(polls: Iterable[Poll], together: Iterable[Span]) -> Iterator[Poll]:
    """Cut polls into single addresses, but for the spans that are `together` within one of them."""
    spans = tuple(together)
    for poll in polls:
        ends: dict[int, int] = {}
        for span in spans:
            if poll.span.has(span):
                ends[span.start] = max(span.end, ends.get(span.start, 0))
        first = end = poll.first
        for address in range(poll.first, poll.last + 1):
            end = max(end, address + 1, ends.get(address, 0))
            if end == address + 1:
                yield Poll(poll.area, first, address, poll.every)
                first = end


def in_a_row(polls: Iterable[Poll]) -> Iterator[Poll]:
    """Join polls that follow one another: the opposite of `apart`."""
    row: Poll | None = None
    for poll in polls:
        if row is not None and (row.area, row.last + 1) == (poll.area, poll.first):
            row = row._replace(last=poll.last)
        else:
            if row is not None:
                yield row
            row = poll
    if row is not None:
        yield row


def joined(polls: Iterable[Poll], rules: ReadRules, holes: Holes) -> Iterator[Poll]:
    """Join polls with the same interval into as few requests as the rules allow; equal ones are one.

    `holes` are those that the device has refused. They come one by one: there may be many.
    """
    group: list[Poll] = []
    last = 0
    for poll in sorted(set(polls), key=lambda poll: (poll.area, poll.width, poll.every, poll.first, poll.last)):
        if group and not _fit_together(group[0], last, poll, rules, holes):
            yield _together(tuple(group))
            group = []
        last = max(last, poll.last) if group else poll.last
        group.append(poll)
    if group:
        yield _together(tuple(group))


def _together(polls: tuple[Poll, ...]) -> Poll:
    first = polls[0]
    if len(polls) == 1:
        return first
    return Poll(first.area, first.first, max(each.last for each in polls), first.every, polls, first.width)


def _fit_together(one: Poll, last: int, other: Poll, rules: ReadRules, holes: Holes) -> bool:
    """Tell whether a request from the first address of `one` to `last` can go on to the end of `other`."""
    if (one.area, one.width, one.every) != (other.area, other.width, other.every):
        return False
    if max(last, other.last) - one.first >= rules.most(one.area, one.width):
        return False
    hole = Span(one.area, last + 1, other.first - last - 1)
    return hole.count <= 0 or (rules.allows(hole) and not holes.refuse(hole))
