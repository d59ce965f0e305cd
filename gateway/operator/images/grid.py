"""The values of an image or mirror as a grid: some addresses in a chosen type, with ages and last writers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.images.kept import ImageWindow, PolledAge, Written
from gateway.operator.operations.answers.values import Cell, CellState
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
        """Make a value; one that is polled has a state, and clients do not get what is not fresh."""
        age, stale = oldest(each.age_ms for each in ages), self.window.stale_ms
        state: CellState = "fresh" if all(each.is_valid for each in ages) else "invalid"
        if age is None:
            state = "unknown"
        elif stale is not None and age > stale:
            state = "stale"
        is_known, told = state in ("fresh", "stale"), reading.as_json(with_area=False)
        return Cell(
            **told if is_known else told | {"value": None, "registers": []},
            text=reading.text if is_known else "",
            state=state,
            source=", ".join(dict.fromkeys(each.source for each in ages)) or None,
            age_ms=age if ages else None,
            writer=None if writer is None else writer.client,
            written_ms=None if writer is None else writer.ago_ms,
        )


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
