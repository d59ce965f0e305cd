"""A device's response times by function and item count, as in its manual."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Self


@dataclass(frozen=True, slots=True)
class Point:
    """The device responds to a request for `items` items within `time` seconds."""

    items: int
    time: float


@dataclass(frozen=True, slots=True)
class TimingTable:
    """Response times: for each function its points, ascending in items, with straight lines between them."""

    rows: Mapping[int, tuple[Point, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, points: Mapping[int, list[Point]]) -> Self:
        """Make the table of these points, in any order.

        Raises:
            ValueError: two points of a function have the same items, or a time decreases.
        """
        rows = {function: tuple(sorted(row, key=lambda point: point.items)) for function, row in points.items()}
        for function, row in rows.items():
            for one, next_one in pairwise(row):
                if one.items == next_one.items:
                    raise ValueError(f"function {function} has two times for {one.items} items")
                if one.time > next_one.time:
                    raise ValueError(f"function {function}: more items cannot take less time ({next_one.items} items)")
        return cls(rows)

    def time(self, function: int, items: int) -> float | None:
        """Compute the seconds the device may take; None if the table has no row for the function.

        Linear between points, flat before the first, continued with the last slope after the last.
        """
        row = self.rows.get(function)
        if row is None:
            return None
        at = bisect_left(row, items, key=lambda point: point.items)
        if at == 0 or len(row) == 1:
            return row[0].time
        left, right = row[min(at, len(row) - 1) - 1], row[min(at, len(row) - 1)]
        slope = (right.time - left.time) / (right.items - left.items)
        return left.time + slope * (items - left.items)

    @property
    def slowest(self) -> float:
        """The longest time of any point; 0 for an empty table."""
        return max((point.time for row in self.rows.values() for point in row), default=0.0)
