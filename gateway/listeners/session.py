from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class ListenSettings:
    """One address where clients connect. Times in seconds; `idle` 0 keeps connections for ever."""

    name: str
    host: str
    port: int
    clients: int = 32
    idle: float = 600.0
    in_flight: int = 16
    unit0: Literal["refuse", "broadcast"] | int = "refuse"
    source: str = ""
