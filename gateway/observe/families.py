"""Metrics as they are counted, for whoever writes them down."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

#: The labels of one value, in the order of its family.
Labels = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Spread:
    """A histogram: how many values did not exceed each bound, and the sum of all."""

    buckets: Sequence[tuple[float, int]]
    count: int
    total: float


@dataclass(slots=True)
class Family:
    """All values of one metric. `name` is without prefix; a counter's is without `_total` too."""

    kind: Literal["counter", "gauge", "histogram"]
    name: str
    text: str
    labels: Labels = ()
    values: list[tuple[Labels, float | Spread]] = field(default_factory=list)

    def add(self, value: float | Spread, *labels: str) -> None:
        """Add the value with these labels."""
        self.values.append((labels, value))
