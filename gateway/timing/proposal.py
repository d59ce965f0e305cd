"""A timing table from measured response times: the lines through them, and the margin that the slowest needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from math import ceil

from gateway.timing.fit import Fit, fit
from gateway.timing.verdict import CLOSE


@dataclass(frozen=True, slots=True)
class Row:
    """The response times of one function with so many items, in seconds, and what the limit is now.

    `allowed_ms` is the part of the limit that is for the device; the rest is the response on the wire, and latency.
    `times` may be those of some of the `count` responses only: the slowest of all was `longest`, if that is more.
    """

    function: int
    items: int
    times: tuple[float, ...]
    limit_ms: float
    allowed_ms: float
    longest: float = 0.0
    count: int = 0

    @property
    def slowest(self) -> float:
        """The longest time of all."""
        return max(self.longest, *self.times)

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
        """What the table is to be multiplied with: as now, or more, so that no response so far would be near its limit.

        The slowest counts and not the last ones: otherwise each look would propose another limit.
        """
        needed = [row.slowest / CLOSE / max(self.fitted(row), 0.001) for row in self.rows]
        return max(self._present_margin, ceil(round(10 * max(needed), 6)) / 10)

    def fitted(self, row: Row) -> float:
        """The time of a row's requests by the table, in seconds."""
        return self.fits[row.function].time(row.items)

    def limit(self, row: Row) -> float:
        """The limit that a row's requests would have, in seconds."""
        return (row.limit_ms - row.allowed_ms) / 1000 + self.margin * max(self.fitted(row), 0.001)
