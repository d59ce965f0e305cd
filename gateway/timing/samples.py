"""The last response times of a device by function and number of items: what its timing table can be found from."""

from collections import deque
from typing import Final

#: For each function, at most this many different numbers of items are kept, and for each of them this many times.
MOST_SIZES: Final = 24
KEPT: Final = 32


class Row:
    """Responses with the same number of items: how many there were, the last times, and the longest, in seconds."""

    __slots__ = ("count", "longest", "times")

    def __init__(self) -> None:
        self.count = 0
        self.longest = 0.0
        self.times: deque[float] = deque(maxlen=KEPT)


class Samples:
    """Times from the end of a request to the end of its normal response, by number of items."""

    __slots__ = ("rows",)

    def __init__(self) -> None:
        self.rows: dict[int, Row] = {}

    def add(self, items: int, seconds: float) -> None:
        """A response has come. Beyond MOST_SIZES, new numbers of items are left out."""
        row = self.rows.get(items)
        if row is None:
            if len(self.rows) >= MOST_SIZES:
                return
            row = self.rows[items] = Row()
        row.count += 1
        row.times.append(seconds)
        row.longest = max(row.longest, seconds)
