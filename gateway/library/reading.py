"""The value of a point."""

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from time import monotonic


@dataclass(frozen=True, slots=True)
class Reading:
    """The `value` of a point in its `unit`, such as `kg`; None if the device says that there is none.

    It is a number; text, or one of the point's labels; True or False for a bit. `time`, in UTC, is when the answer came
    that has it; of a mirror or a virtual unit, when the poll was asked that it is from. So it is never older than its
    `age` says, by more than the answer took.
    """

    point: str
    value: float | str | bool | None
    unit: str = ""
    time: datetime = field(default_factory=lambda: datetime.now(UTC))
    _taken: float = field(default_factory=monotonic, repr=False, compare=False, kw_only=True)

    @property
    def age(self) -> float:
        """How old it is now, in seconds."""
        return monotonic() - self._taken

    def __str__(self) -> str:
        return f"{self.value} {self.unit}".rstrip()


def reading_of_age(point: str, value: float | str | bool | None, unit: str, age: float) -> Reading:  # noqa: FBT001
    """Make a reading that is `age` seconds old now."""
    return Reading(point, value, unit, datetime.now(UTC) - timedelta(seconds=age), _taken=monotonic() - age)
