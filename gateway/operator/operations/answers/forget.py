"""The result of `forget`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Forgotten:
    """A device that is asked at the `unit` and `baud` of the config again, instead of `was_at` and `was_baud`."""

    line: str
    device: str
    unit: int
    was_at: tuple[int, ...]
    baud: int
    was_baud: int
