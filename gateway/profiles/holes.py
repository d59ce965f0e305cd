"""Holes: addresses between those that are wanted, which are read with them so that one request is enough.

A device may refuse them though its profile allows them. Then the request is split at one of its holes, each part again
if it must be, until all that was wanted is read. The holes at which it was split are remembered.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from gateway.modbus.pdu import Span

#: The most refused holes that are remembered of a device; for further ones the oldest is forgotten.
MOST_HOLES: Final = 256


class Holes:
    """The holes that a device has refused."""

    def __init__(self) -> None:
        self._refused: dict[Span, None] = {}

    def add(self, hole: Span) -> None:
        """Remember a hole that was refused."""
        self._refused[hole] = None
        if len(self._refused) > MOST_HOLES:
            del self._refused[next(iter(self._refused))]

    def refuse(self, hole: Span) -> bool:
        """Tell whether a hole contains one that was refused."""
        return any(
            each.area is hole.area and hole.start <= each.start and each.end <= hole.end for each in self._refused
        )

    @property
    def refused(self) -> tuple[Span, ...]:
        """Those that are remembered."""
        return tuple(self._refused)


@dataclass(slots=True, eq=False)
class Split:
    """A refused request that was split at a hole, in two `unread` parts; it was itself a part of the split `above`."""

    hole: Span
    holes: Holes
    above: "Split | None" = None
    unread: int = 2

    def part_was_read(self) -> None:
        """Note that all of a part was read. After both the hole is remembered: the whole was refused."""
        self.unread -= 1
        if self.unread == 0:
            self.holes.add(self.hole)
            if self.above is not None:
                self.above.part_was_read()


def holes_between(spans: Iterable[Span]) -> list[Span]:
    """Find the holes between spans of one area, which are in the order of their starts."""
    found: list[Span] = []
    end: int | None = None
    for span in spans:
        if end is not None and span.start > end:
            found.append(Span(span.area, end, span.start - end))
        end = span.end if end is None else max(end, span.end)
    return found


def middle_hole(spans: Iterable[Span]) -> Span | None:
    """Choose the hole at which a refused request is split; None if it has none."""
    holes = holes_between(spans)
    return holes[len(holes) // 2] if holes else None
