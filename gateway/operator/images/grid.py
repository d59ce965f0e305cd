"""The values of an image or mirror as a grid: some addresses in a chosen type, with ages and last writers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.kept import ImageWindow, PolledAge, Written
from gateway.operator.operations.answers import values as answers
from gateway.operator.status.unit_status import oldest
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading
from gateway.registers.datatypes import registers_of
from gateway.registers.items import has_bits

#: Addresses that are shown at a time, and the columns of a row.
MOST: Final = 400
COLUMNS: Final = 10
_TEXT_COLUMNS: Final = 2


@dataclass(frozen=True, slots=True)
class Cell:
    """One value. One that is polled has a state; clients do not get what is not fresh. `source` is where it is from."""

    reading: Reading
    state: answers.CellState = "fresh"
    source: str = ""
    age_ms: float | None = None
    written: Written | None = None

    @property
    def text(self) -> str:
        """The value as text; empty while there is none."""
        return self.reading.point.show(self.reading.value) if self.is_known else ""

    @property
    def is_known(self) -> bool:
        """Whether there is a value."""
        return self.state in ("fresh", "stale")

    def told(self) -> answers.Cell:
        """Convert it to the result type."""
        told = self.reading.as_json(with_area=False)
        if not self.is_known:
            told |= {"value": None, "registers": []}
        return answers.Cell(
            **told,
            text=self.text,
            state=self.state,
            source=self.source or None,
            age_ms=self.age_ms,
            writer=None if self.written is None else self.written.client,
            written_ms=None if self.written is None else self.written.ago_ms,
        )


@dataclass(frozen=True, slots=True)
class Grid:
    """An image window in one type, with `size` addresses per cell and `columns` cells per row."""

    window: ImageWindow
    area: Area
    type: str
    swap: str
    size: int
    columns: int

    def rows(self) -> Iterator[tuple[int, Sequence[Cell]]]:
        """Yield each row with its first address. Addresses that do not make a whole value at the end are left out."""
        width = self.size * self.columns
        for span, items in self.window.parts:
            cells, first = self._cells(span, items), span.start
            while row := list(islice(cells, self.columns)):
                yield first, row
                first += width

    def _cells(self, span: Span, items: bytes) -> Iterator[Cell]:
        written, width = _writers(self.window.writes, self.area), len(items) // span.count
        ages = _ages(self.window.ages, span)
        for address in range(span.start, span.end - self.size + 1, self.size):
            point = Point("", self.area, address, self.type, self.swap, self.size)
            begin = (address - span.start) * width
            reading = Reading(point, items[begin : begin + self.size * width])
            here = range(address, address + self.size)
            writer = next((written[each] for each in here if each in written), None)
            yield self._cell(reading, [age for each in here for age in ages.get(each, ())], writer)

    def _cell(self, reading: Reading, ages: Sequence[PolledAge], writer: Written | None) -> Cell:
        if not ages:
            return Cell(reading, written=writer)
        source = ", ".join(dict.fromkeys(each.source for each in ages))
        age, stale = oldest(each.age_ms for each in ages), self.window.stale_ms
        if age is None:
            return Cell(reading, "unknown", source, written=writer)
        is_stale = stale is not None and age > stale
        is_valid = all(each.is_valid for each in ages)
        return Cell(reading, "stale" if is_stale else "fresh" if is_valid else "invalid", source, age, writer)


def grid_of(window: ImageWindow, area: Area, data_type: str, swap: str) -> Grid:
    """Make the grid of a window; an empty type means `bit` or `uint16`. Type and swap must be valid."""
    data_type = data_type or ("bit" if has_bits(area) else "uint16")
    if data_type == "string":
        return Grid(window, area, data_type, swap, COLUMNS, _TEXT_COLUMNS)
    size = registers_of(data_type)
    return Grid(window, area, data_type, swap, size, COLUMNS if size == 1 else COLUMNS // 2)


def _writers(writes: Sequence[Written], area: Area) -> dict[int, Written]:
    """Find the last write to each address; writes to more than MOST addresses are left out."""
    found: dict[int, Written] = {}
    for each in writes:  # the newest first
        if each.span.area == area and each.span.count <= MOST:
            for address in range(each.span.start, each.span.end):
                found.setdefault(address, each)
    return found


def _ages(ages: Sequence[PolledAge], span: Span) -> dict[int, list[PolledAge]]:
    """Find the ages that count for each address of a span."""
    found: dict[int, list[PolledAge]] = {}
    for each in ages:
        for address in range(max(each.span.start, span.start), min(each.span.end, span.end)):
            found.setdefault(address, []).append(each)
    return found
