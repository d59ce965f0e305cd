"""A device that is asked where the config says again."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Forgotten:
    """A device, and what the config says of it and of its line. It was expected at one of the units in `was_at`."""

    line: str
    device: str
    unit: int
    was_at: tuple[int, ...]
    baud: int
    was_baud: int
