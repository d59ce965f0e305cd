"""The value of a point."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from time import monotonic


@dataclass(frozen=True, slots=True)
class Reading:
    """The `value` of a point in its `unit`, such as `kg`; None if the device says that there is none.

    `time` is when the answer came that holds it, in UTC.
    """

    point: str
    value: float | str | bool | None
    unit: str = ""
    time: datetime = field(default_factory=lambda: datetime.now(UTC))
    _taken: float = field(default_factory=monotonic, repr=False, compare=False)

    @property
    def age(self) -> float:
        """How old it is now, in seconds."""
        return monotonic() - self._taken

    def __str__(self) -> str:
        return f"{self.value} {self.unit}".rstrip()
