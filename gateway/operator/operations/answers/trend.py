"""The trend of a point."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from gateway.operator.operations.answers.values import IF_KNOWN


@dataclass(frozen=True, slots=True)
class TrendSlot:
    """What was heard of a point in the slot that begins at `time`: the least, the mean and the greatest value."""

    time: str
    min: float
    mean: float
    max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PointTrend:
    """The trend of the `point` of a `device` in slots of `step_s` seconds, oldest first, in its `measure`, such as kg.

    Slots in which nothing was heard of it are missing. Times are RFC 3339 text.
    """

    device: str
    point: str
    measure: str | None = field(default=None, metadata=IF_KNOWN)
    step_s: int
    slots: Sequence[TrendSlot]
