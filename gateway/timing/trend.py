"""Trends of points: least, mean and greatest value in each slot of time, in pieces as a file has them.

A piece has the slots of one block of time of one point: an array of least, mean and greatest value of each slot, which
are not numbers where nothing was heard. A slot is known by its begin in seconds since 1970, as a block is.
"""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from math import floor, log10, nan
from struct import Struct, error
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    Piece = array[float]
    #: The mean of one slot after another; not a number where nothing was heard.
    Means = array[float]
else:  # it has no parameters before Python 3.12
    Piece = Means = array

#: A day is kept in slots of a minute, and more in slots of ten.
SHORT: Final = 24 * 3600
_MINUTE: Final = 60
#: The most bytes that all trends take on the disk: those of the file, and of its log beside it.
MOST_BYTES: Final = 32 * 2**20
LOG_BYTES: Final = 6 * 2**20
#: What a piece takes in the file beside its content, and how full its pages are.
_ROW_BYTES: Final = 31
_FILLED: Final = 0.9

#: Numbers of no machine, up or down, have no trend: the difference of two others is always a float32.
GREATEST: Final = 1e37
#: The numbers of a slot.
_NUMBERS: Final = 3
#: Which slots there are, and the first least value.
_HEAD: Final = Struct("<Hd")
#: The digits of a difference that a float32 keeps.
_DIGITS: Final = 7


class Slot(NamedTuple):
    """What was heard of a point in the slot that begins at `time`."""

    time: int
    least: float
    mean: float
    greatest: float


@dataclass(frozen=True, slots=True)
class Layout:
    """How trends are kept: for `kept` seconds in slots of `step`, which are written in pieces of `block` seconds."""

    kept: int
    step: int
    block: int

    @classmethod
    def of(cls, kept: float) -> "Layout":
        """Choose slots that suit: of a minute for up to a day, of ten minutes for more."""
        return cls(int(kept), _MINUTE, 10 * _MINUTE) if kept <= SHORT else cls(int(kept), 10 * _MINUTE, 60 * _MINUTE)

    @property
    def points(self) -> int:
        """How many points have room, if the values of all change all the time."""
        content = _HEAD.size + 4 * _NUMBERS * self.slots
        return int((MOST_BYTES - LOG_BYTES) * _FILLED / ((_ROW_BYTES + content) * (self.kept / self.block + 1)))

    @property
    def slots(self) -> int:
        """The slots of a piece."""
        return self.block // self.step

    def block_at(self, time: float) -> int:
        """Find the block of a time."""
        return int(time // self.block) * self.block

    def slot_at(self, time: float) -> int:
        """Find the slot of a time."""
        return int(time // self.step) * self.step

    def piece(self) -> Piece:
        """Make a piece of which nothing is known."""
        return array("d", [nan]) * (_NUMBERS * self.slots)

    def place(self, slot: int) -> int:
        """Find the place of a slot in its piece."""
        return slot % self.block // self.step * _NUMBERS

    def within(self, block: int, piece: Piece) -> Iterator[Slot]:
        """Yield the slots of a piece in which something was heard."""
        for at in _known(piece):
            yield Slot(block + at // _NUMBERS * self.step, *piece[at : at + _NUMBERS])


def mean_of(total: float, count: float, least: float, greatest: float) -> float:
    """Compute a mean to 12 digits; rounding puts it neither below the least number nor above the greatest one."""
    return min(max(float(f"{total / count:.12g}"), least), greatest)


def put(piece: Piece, place: int, numbers: Sequence[float]) -> None:
    """Add least, mean and greatest value of what was heard later in a slot; if it had any, the new mean stays."""
    least, mean, greatest = numbers
    if _is_number(piece[place]):
        least, greatest = min(least, piece[place]), max(greatest, piece[place + 2])
    piece[place : place + _NUMBERS] = array("d", (least, mean, greatest))


def merge(piece: Piece, later: Piece) -> None:
    """Add what was heard later, as `put` does, slot by slot."""
    for at in _known(later):
        put(piece, at, later[at : at + _NUMBERS])


def pack(piece: Piece) -> bytes:
    """Write a piece, of which something is known: the first number, and the differences from it as float32.

    A float32 alone has too few digits for a counter. Zeros at the end are left out: values that do not change are
    short.
    """
    known = list(_known(piece))
    first = piece[known[0]]
    numbers = chain.from_iterable(piece[at : at + _NUMBERS] for at in known)
    differences = [number - first for number in numbers]
    content = _HEAD.pack(sum(1 << at // _NUMBERS for at in known), first)
    return content + Struct(f"<{len(differences)}f").pack(*differences).rstrip(b"\0")


def unpack(content: bytes, layout: Layout) -> Piece:
    """Read what `pack` has written.

    Raises:
        ValueError: it has not, or for another layout.
    """
    piece = layout.piece()
    try:
        slots, first = _HEAD.unpack_from(content)
        places = [at for at in range(0, len(piece), _NUMBERS) if slots >> at // _NUMBERS & 1]
        numbers = Struct(f"<{_NUMBERS * len(places)}f")
        differences = numbers.unpack(content[_HEAD.size :].ljust(numbers.size, b"\0"))
    except error as wrong:
        raise ValueError(str(wrong)) from wrong
    for number, at in enumerate(places):
        there = differences[_NUMBERS * number : _NUMBERS * (number + 1)]
        least, mean, greatest = (_sum(first, each) for each in there)
        least, greatest = min(least, greatest), max(least, greatest)  # each is rounded for itself
        piece[at : at + _NUMBERS] = array("d", (least, min(max(mean, least), greatest), greatest))
    return piece


def _sum(first: float, difference: float) -> float:
    """Add a difference with no more digits than it has."""
    return round(first + difference, _DIGITS - 1 - floor(log10(abs(difference)))) if difference else first


def _known(piece: Piece) -> Iterator[int]:
    """Yield the places of the slots in which something was heard."""
    return (at for at in range(0, len(piece), _NUMBERS) if _is_number(piece[at]))


def _is_number(number: float) -> bool:
    return number == number  # noqa: PLR0124 - what is not a number is not equal to itself
