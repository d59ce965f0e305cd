"""A table of parts of an answer, described by its columns."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.cli.kit.columns import align, narrow
from gateway.cli.kit.paint import badness

W = TypeVar("W")
Row = TypeVar("Row")

_INDENT: Final = "  "
#: The columns whose texts may be shortened.
_FLEXIBLE: Final = frozenset(
    {"NAME", "PORT", "ADDRESS", "AT", "DEVICE", "OF", "AGES", "CLIENT", "LISTENER", "REASON", "DOWN"}
)


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
