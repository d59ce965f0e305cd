"""Which row decides about a request to one unit: at each of its addresses the first that has it, or has no addresses.

Nothing is searched address by address: the rows of an area are turned into stretches with the same row once.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.functions import READERS, TABLE_FUNCTIONS, only_reads, row_of
from gateway.modbus.pdu import ADDRESSES, Span, spans_of
from gateway.routing.access import NOTHING, WRITING, AccessRow, Right, includes, right_to


@dataclass(frozen=True, slots=True)
class Ruling:
    """Whether a request is allowed, and takes one of the first turns; `refused_at` is an address where it is not."""

    is_allowed: bool
    has_priority: bool = False
    refused_at: str = ""


_REFUSED: Final = Ruling(is_allowed=False)
_ALLOWED: Final = Ruling(is_allowed=True)
_ALLOWED_FIRST: Final = Ruling(is_allowed=True, has_priority=True)


class Deciding:
    """The rows that fit a client and a unit, in their order: those with addresses, and at the end one without.

    The end is missing if there is none: what no row decides is refused. `everywhere` is what is allowed whatever
    addresses a request tells. The router looks no further for what is `plain`: the same, if no row has priority.

    At an address, the first row that has it decides, and a request must be allowed at each of its addresses. Without
    any it is for the row without addresses; but if it may write, it must not pass by a row that does not allow it.
    """

    def __init__(self, rows: Sequence[AccessRow]) -> None:
        self.rows = tuple(rows)
        self._last = self.rows[-1] if self.rows and self.rows[-1].addresses is None else None
        self.everywhere = _everywhere(self.rows, self._last)
        self.plain = NOTHING if any(row.priority == "high" for row in self.rows) else self.everywhere
        #: By area, where each stretch begins, and its row.
        self._stretches: dict[Area, tuple[list[int], list[AccessRow | None]]] = {}

    @property
    def somewhere(self) -> Right:
        """What may be allowed at some address, or without one."""
        rights = (row.right & OF_AREA[area] for area in Area for row in self._stretches_of(area)[1] if row is not None)
        return (NOTHING if self._last is None else self._last.right).union(*rights)

    def ruling(self, pdu: bytes) -> Ruling:
        """Decide about a request."""
        spans = _spans(pdu) if len(self.rows) > (self._last is not None) else []
        if not spans:
            return self._without_addresses(pdu)
        ruling = _ALLOWED
        for span in spans:
            for address, row in self._deciders(span):
                if row is None or not includes(row.right, pdu):
                    return Ruling(is_allowed=False, refused_at=f"{span.area} {address}")
                if row.priority == "high":
                    ruling = _ALLOWED_FIRST
        return ruling

    def _without_addresses(self, pdu: bytes) -> Ruling:
        for row in self.rows:
            if (row.addresses is None or not only_reads(pdu)) and not includes(row.right, pdu):
                return _REFUSED
        if self._last is None:
            return _REFUSED
        return _ALLOWED_FIRST if self._last.priority == "high" else _ALLOWED

    def _deciders(self, span: Span) -> Iterator[tuple[int, AccessRow | None]]:
        """Yield the rows that decide at some addresses, each with its first one."""
        begins, rows = self._stretches_of(span.area)
        at = bisect_right(begins, span.start) - 1
        yield span.start, rows[at]
        for index in range(at + 1, len(begins)):
            if begins[index] >= span.end:
                return
            yield begins[index], rows[index]

    def _stretches_of(self, area: Area) -> tuple[list[int], list[AccessRow | None]]:
        found = self._stretches.get(area)
        if found is None:
            found = self._stretches[area] = _stretches(self.rows, area, self._last)
        return found


def _everywhere(rows: Sequence[AccessRow], last: AccessRow | None) -> Right:
    """Find what is allowed whatever addresses a request tells. A write may tell none, so each row counts for it."""
    if last is None:
        return NOTHING
    rights = {(row.right, frozenset(span.area for span in row.addresses)) for row in rows if row.addresses is not None}
    refused = ((WRITING | right_to(READERS[area][0] for area in areas)) - right for right, areas in rights)
    return last.right.difference(*refused)


def _stretches(
    rows: Sequence[AccessRow], area: Area, last: AccessRow | None
) -> tuple[list[int], list[AccessRow | None]]:
    """Find where each stretch of addresses with the same row begins: the first row that has them, or else `last`."""
    spans = sorted(
        (span.start, index, span.end)
        for index, row in enumerate(rows)
        for span in row.addresses or ()
        if span.area == area
    )
    begins: list[int] = []
    deciding: list[AccessRow | None] = []
    open_rows: list[tuple[int, int]] = []  # the number of each row that has the present address, and its end there
    next_span = 0
    for edge in sorted({0, *(start for start, _, _ in spans), *(end for _, _, end in spans)}):
        while next_span < len(spans) and spans[next_span][0] == edge:
            heappush(open_rows, spans[next_span][1:])
            next_span += 1
        while open_rows and open_rows[0][1] <= edge:
            heappop(open_rows)
        row = rows[open_rows[0][0]] if open_rows else last
        if not begins or deciding[-1] is not row:
            begins.append(edge)
            deciding.append(row)
    return begins, deciding


def _spans(pdu: bytes) -> list[Span]:
    """List the addresses of a request; none if it has none, or does not tell all of them.

    A device may go on at address 0 after the last one.
    """
    row = row_of(pdu)
    told = list(spans_of(pdu))
    if len(told) < (row.reads is not None) + (row.writes is not None) or not all(span.count for span in told):
        return []
    around = [Span(span.area, 0, span.end - ADDRESSES) for span in told if span.end > ADDRESSES]
    return [Span(span.area, span.start, min(span.count, ADDRESSES - span.start)) for span in told] + around


def _functions_of(area: Area) -> Right:
    """Make the right to all functions that have addresses of an area."""
    rows = map(row_of, (bytes((function,)) for function in TABLE_FUNCTIONS))
    return right_to(row.code for row in rows if any(items and items.area == area for items in (row.reads, row.writes)))


#: The right to all functions that have addresses of an area.
OF_AREA: Final = {area: _functions_of(area) for area in Area}
