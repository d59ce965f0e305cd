"""A timing table from measured response times: the lines through them, and the margin that the slowest needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, groupby
from math import ceil
from statistics import median

from gateway.timing.verdict import CLOSE


@dataclass(frozen=True, slots=True)
class Fit:
    """A device's time for `items` items: `start + per_item * items`, in seconds; it never decreases."""

    start: float
    per_item: float

    def time(self, items: int) -> float:
        """Compute the seconds for this many items."""
        return max(self.start + self.per_item * items, 0.0)


def fit(times: Mapping[int, Sequence[float]]) -> Fit:
    """Draw the line through the medians of `times`, by number of items: the median of all slopes (Theil and Sen).

    Up to a half of the times of one number of items may be outliers, and some of these numbers.

    Raises:
        ValueError: there are no times.
    """
    middles = {items: median(values) for items, values in sorted(times.items()) if values}
    if not middles:
        raise ValueError("no response times")
    pairs = combinations(middles.items(), 2)
    slopes = [(slower - faster) / (more - fewer) for (fewer, faster), (more, slower) in pairs]
    per_item = max(median(slopes), 0.0) if slopes else 0.0
    return Fit(median(middle - per_item * items for items, middle in middles.items()), per_item)


@dataclass(frozen=True, slots=True)
class MeasuredTimes:
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
        """Find the time that this share of the responses did not exceed."""
        ordered = sorted(self.times)
        return ordered[min(ceil(share * len(ordered)), len(ordered)) - 1]


class Proposal:
    """What follows from `rows`, ordered by function, for a device that has the `present_margin`.

    `timing` has the function, items and seconds of each row of the table.
    """

    def __init__(self, rows: Sequence[MeasuredTimes], present_margin: float) -> None:
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

    def fitted(self, row: MeasuredTimes) -> float:
        """Compute the time of a row's requests by the table, in seconds."""
        return self.fits[row.function].time(row.items)

    def limit(self, row: MeasuredTimes) -> float:
        """Compute the limit that a row's requests would have, in seconds."""
        return (row.limit_ms - row.allowed_ms) / 1000 + self.margin * max(self.fitted(row), 0.001)
