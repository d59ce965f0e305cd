"""Plain text tables, of cells or of parts of an answer."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.cli.kit.cells import cut, padded, width_of
from gateway.cli.kit.paint import badness, escaped, plain

_BETWEEN = "  "
#: No column gets narrower than this, in cells.
_NARROWEST = 8
#: So many rows that only count are shown by the first and the last one.
_LONG_RUN = 10
_NUMBERS = re.compile(r"([0-9]+)")
W = TypeVar("W")
Row = TypeVar("Row")

_INDENT: Final = "  "
#: The columns whose texts may be shortened.
_FLEXIBLE: Final = frozenset(
    {"NAME", "PORT", "ADDRESS", "AT", "DEVICE", "OF", "AGES", "CLIENT", "LISTENER", "REASON", "DOWN"}
)


def align(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """Align the columns of `rows`; the first row has the headings. A cell is one line, whatever is in it."""
    rows = [[escaped(cell).replace("\n", r"\n") for cell in row] for row in rows]
    widths = [max(map(width_of, column)) for column in zip(*rows, strict=True)]
    return "\n".join(indent + _BETWEEN.join(map(padded, row, widths)).rstrip() for row in rows)


def narrow(rows: Sequence[Sequence[str]], flexible: Collection[int], width: int) -> list[list[str]]:
    """Shorten the `flexible` columns until each row fits into `width` cells.

    Where that is not enough nothing is shortened: the rows are too long in any case.
    """
    widths = [max(map(width_of, column)) for column in zip(*rows, strict=True)]
    least = [min(each, _NARROWEST) if place in flexible else each for place, each in enumerate(widths)]
    if sum(least) + len(_BETWEEN) * (len(widths) - 1) > width:
        return [list(row) for row in rows]
    while sum(widths) + len(_BETWEEN) * (len(widths) - 1) > width:
        widest = max(flexible, key=widths.__getitem__, default=None)
        if widest is None or widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    return [list(map(shorten, row, widths)) for row in rows]


def without_middles(rows: Sequence[Sequence[str]], counted: Collection[int]) -> list[Sequence[str]]:
    """Leave out the middle of long runs of rows that are equal but for numbers that count in the `counted` columns."""
    shown: list[Sequence[str]] = []
    run: list[Sequence[str]] = []
    for row in rows:
        if run and not _follows(run[-1], row, counted):
            shown += _without_middle(run)
            run = []
        run.append(row)
    return shown + _without_middle(run)


def _without_middle(run: list[Sequence[str]]) -> list[Sequence[str]]:
    if len(run) < _LONG_RUN:
        return run
    return [run[0], ("...", *[""] * (len(run[0]) - 1)), run[-1]]


def _follows(before: Sequence[str], row: Sequence[str], counted: Collection[int]) -> bool:
    """Tell whether each counted cell has the same numbers as the one `before`, or one more at one place."""
    for place, (one, other) in enumerate(zip(before, row, strict=True)):
        parts, others = _NUMBERS.split(one), _NUMBERS.split(other)
        steps = [(a, b) for a, b in zip(parts, others, strict=False) if a != b]
        is_next = len(parts) == len(others) and len(steps) == 1 and _is_next(*steps[0])
        if one != other and not (place in counted and is_next):
            return False
    return True


def _is_next(one: str, other: str) -> bool:
    return one.isdecimal() and other.isdecimal() and int(other) == int(one) + 1


def shorten(text: str, width: int) -> str:
    """Shorten `text` to at most `width` cells by cutting out its middle, and its paint."""
    whole = width_of(text)
    if whole <= width:
        return text
    text, end = plain(text), (width - 1) * 2 // 3
    return f"{cut(text, width - 1 - end)}…{cut(text, end, whole - end)}"


@dataclass(frozen=True)
class Table(Generic[W, Row]):
    """A table: its title, how its `rows` are found in the whole answer, and its columns by their headings.

    Rows with a cell in red stand above the others, and below them those with one in yellow.
    """

    title: str
    rows: Callable[[W], Iterable[Row]]
    columns: Mapping[str, Callable[[Row], object]]

    def show(self, whole: W, width: int) -> str:
        """Show the table, `width` characters wide unless texts are too long; nothing if it has no rows."""
        cells = [[str(cell(row)) for cell in self.columns.values()] for row in self.rows(whole)]
        if not cells:
            return ""
        cells.sort(key=lambda row: -max(map(badness, row)))
        flexible = [place for place, heading in enumerate(self.columns) if heading in _FLEXIBLE]
        rows = narrow([tuple(self.columns), *cells], flexible, width - len(_INDENT))
        return f"{self.title}\n{align(rows, _INDENT)}"
