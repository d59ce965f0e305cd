"""The straight line through measured response times, which outliers do not bend."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median


@dataclass(frozen=True, slots=True)
class Fit:
    """A device's time for `items` items: `start + per_item * items`, in seconds; it never decreases."""

    start: float
    per_item: float

    def time(self, items: int) -> float:
        """Seconds for this many items."""
        return max(self.start + self.per_item * items, 0.0)


def fit(times: Mapping[int, Sequence[float]]) -> Fit:
    """The line through the medians of `times`, which go by number of items: the median of all slopes (Theil and Sen).

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
