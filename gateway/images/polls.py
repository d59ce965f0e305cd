"""The polls of a mirror: as few requests as the device allows."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Profile, Range
from gateway.registers.items import read_request

#: The functions that a mirror answers from its polls.
POLLING_FUNCTIONS: Final = frozenset(function for function, _ in READERS.values())


@dataclass(frozen=True, slots=True)
class Poll:
    """A range of addresses that is read with one request every `every` seconds.

    `parts` are the ranges that it was joined from: they are read one by one if the device refuses the whole.
    """

    area: Area
    first: int
    last: int
    every: float
    parts: "tuple[Poll, ...]" = ()

    @property
    def request(self) -> bytes:
        """The request PDU."""
        return read_request(Span(self.area, self.first, self.last - self.first + 1))

    def __str__(self) -> str:
        return f"{self.area} {self.first}-{self.last}"


@dataclass(frozen=True, slots=True)
class MirrorSettings:
    """A mirror of the device named `of`, which has `profile`. `areas` are the addresses of all `polls`.

    Values older than `stale` seconds are not sent.
    """

    unit: int
    name: str
    of: str
    profile: Profile
    polls: tuple[Poll, ...]
    areas: Mapping[Area, tuple[Range, ...]]
    stale: float
    source: str = field(default="", compare=False)


def polling_function(area: Area) -> int:
    """Return the function that reads an area."""
    return READERS[area][0]


def joined(polls: Iterable[Poll], limits: Mapping[int, int]) -> list[Poll]:
    """Join polls into as few requests as possible: neighbours with the same interval are read together.

    `limits` is the most items that the device allows, by function; longer ranges are split.
    """
    result: list[Poll] = []
    for poll in sorted(_cut(polls, limits), key=lambda poll: (poll.area, poll.every, poll.first)):
        before = result[-1] if result else None
        if before is not None and _fit_together(before, poll, limits):
            result[-1] = Poll(poll.area, before.first, poll.last, poll.every, (*(before.parts or (before,)), poll))
        else:
            result.append(poll)
    return result


def _cut(polls: Iterable[Poll], limits: Mapping[int, int]) -> Iterator[Poll]:
    for poll in polls:
        most = _most(poll.area, limits)
        for first in range(poll.first, poll.last + 1, most):
            yield Poll(poll.area, first, min(first + most - 1, poll.last), poll.every)


def _fit_together(one: Poll, other: Poll, limits: Mapping[int, int]) -> bool:
    return (one.area, one.every, one.last + 1) == (
        other.area,
        other.every,
        other.first,
    ) and other.last - one.first < _most(one.area, limits)


def _most(area: Area, limits: Mapping[int, int]) -> int:
    function, most = READERS[area]
    return min(most, limits.get(function, most))
