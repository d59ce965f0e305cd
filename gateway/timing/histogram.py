"""Histograms: counts of values in fixed buckets, and quantiles of them."""

from collections.abc import Iterable, Sequence
from typing import Final


class Scale:
    """The upper bounds of buckets, in whole thousandths. One more bucket has no bound.

    A value on a bound counts in the next bucket.
    """

    __slots__ = ("bounds", "places")

    def __init__(self, thousandths: Sequence[int]) -> None:
        self.bounds = tuple(bound / 1000 for bound in thousandths)
        #: The bucket of each thousandth below the last bound.
        self.places = bytes(
            place for place, bound in enumerate(thousandths) for _ in range(([0, *thousandths][place]), bound)
        )


#: For durations: 1 ms to 10 s.
SECONDS: Final = Scale(
    (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 10_000)
)
#: For shares: steps of a twentieth.
SHARES: Final = Scale(tuple(range(50, 1001, 50)))


class Histogram:
    """Counts of values by the buckets of a scale. `total` is the sum of the values."""

    __slots__ = ("_end", "_last", "_places", "counts", "scale", "total")

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self.counts = [0] * (len(scale.bounds) + 1)
        self.total = 0.0
        self._places = scale.places
        self._end = len(scale.places)
        self._last = len(scale.bounds)

    def add(self, value: float) -> None:
        """Count a value; a negative one as 0."""
        bucket = 0
        if value > 0.0:
            self.total += value
            thousandths = int(value * 1000.0)
            bucket = self._places[thousandths] if thousandths < self._end else self._last
        counts = self.counts
        count: int = counts[bucket]
        counts[bucket] = count + 1  # with += the compiler takes it for any object

    def quantile(self, share: float) -> float | None:
        """Find the value that this share of all does not exceed, as exact as the buckets; None without values."""
        rank, below = share * sum(self.counts), 0
        if not rank:
            return None
        lower = 0.0
        for upper, count in zip(self.scale.bounds, self.counts, strict=False):
            if below + count >= rank:
                return lower + (upper - lower) * (rank - below) / count
            lower = upper
            below += count
        return lower


def merged(scale: Scale, histograms: Iterable[Histogram]) -> Histogram:
    """Add up `histograms`, which all have this `scale`."""
    whole = Histogram(scale)
    for each in histograms:
        whole.counts = [one + other for one, other in zip(whole.counts, each.counts, strict=True)]
        whole.total += each.total
    return whole
