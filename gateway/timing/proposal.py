"""A timing table from measured response times: the lines through them, and the margin that the slowest need."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from math import ceil

from gateway.timing.fit import Fit, fit


@dataclass(frozen=True, slots=True)
class Row:
    """The response times of one function with so many items, in seconds, and what the limit is now.

    `allowed_ms` is the part of the limit that is for the device; the rest is the response on the wire, and latency.
    """

    function: int
    items: int
    times: tuple[float, ...]
    limit_ms: float
    allowed_ms: float

    def quantile(self, share: float) -> float:
        """The time that this share of the responses did not exceed."""
        ordered = sorted(self.times)
        return ordered[min(ceil(share * len(ordered)), len(ordered)) - 1]


class Proposal:
    """What follows from `rows`, ordered by function, for a device that has the `present_margin`.

    `timing` has the function, items and seconds of each row of the table.
    """

    def __init__(self, rows: Sequence[Row], present_margin: float) -> None:
        self.rows = tuple(rows)
        self.fits: dict[int, Fit] = {}
        self.timing: list[tuple[int, int, float]] = []
        self._present_margin = present_margin
        for function, of_function in groupby(self.rows, lambda row: row.function):
            sizes = {row.items: row.times for row in of_function}
            self.fits[function] = line = fit(sizes)
            ends = dict.fromkeys((min(sizes), max(sizes)))
            self.timing += [(function, items, line.time(items)) for items in ends]

    @cached_property
    def margin(self) -> float:
        """What the table is to be multiplied with: as now, or more where 99 of 100 responses need it."""
        needed = [row.quantile(0.99) / max(self.fitted(row), 0.001) for row in self.rows]
        return max(self._present_margin, ceil(10 * max(needed)) / 10)

    def fitted(self, row: Row) -> float:
        """The time of a row's requests by the table, in seconds."""
        return self.fits[row.function].time(row.items)

    def limit(self, row: Row) -> float:
        """The limit that a row's requests would have, in seconds."""
        return (row.limit_ms - row.allowed_ms) / 1000 + self.margin * max(self.fitted(row), 0.001)
