"""The record of a run: what devices have answered, and what a gateway has published of it.

Times are Unix times in seconds by the clock of the judge. That of the gateway is `Record.offset` ahead of it.
"""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple


class Answer(NamedTuple):
    """What a device has answered at a time, by the names of its points."""

    device: str
    at: float
    values: Mapping[str, int]


class Entry(NamedTuple):
    """Values with the time that the gateway tells. `is_unsure`: it says that its clock may have been wrong."""

    at: float
    values: Mapping[str, int]
    is_unsure: bool = False


class Told(NamedTuple):
    """A message with values of a device: sent by the gateway in its so-manyth connection, or heard by a subscriber.

    `shares_time`: its entry has all values of the device with the time of the newest one.
    """

    at: float
    device: str
    is_history: bool
    entries: tuple[Entry, ...]
    qos: int = 1
    is_retained: bool = False
    connection: int = 0
    #: When the broker had confirmed it; None if it never has, or cannot.
    confirmed_at: float | None = None
    shares_time: bool = False


class Break(NamedTuple):
    """An end at a time: what was heard up to `reach` seconds before it may be told again."""

    at: float
    reach: float


@dataclass
class Record:
    """A run. `every` is the interval of each point, `limit` how long a read may take, in seconds."""

    every: Mapping[str, float]
    limit: float
    #: How long this machine may be busy with something else, in seconds.
    late: float = 1.0
    #: Points that keep their value over several answers: it must come once.
    slow: frozenset[str] = frozenset()
    answers: list[Answer] = field(default_factory=list)
    sent: list[Told] = field(default_factory=list)
    heard: list[Told] = field(default_factory=list)
    #: What was answered between these times may be lost.
    may_lose: list[tuple[float, float]] = field(default_factory=list)
    #: When a device had not answered in time: what it answers then is not taken.
    too_late: list[tuple[str, float]] = field(default_factory=list)
    breaks: list[Break] = field(default_factory=list)
    #: A proper end may come before all history was sent: what a birth has told meanwhile may be in it again.
    clean_ends: list[Break] = field(default_factory=list)
    #: When sessions may have begun or ended in any way: a birth tells the latest values again.
    ends: list[float] = field(default_factory=list)
    #: How much the gateway's clock is ahead from a time on.
    clock: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])
    live_qos: int = 1
    live_retained: bool = True
    history_qos: int = 1

    def offset(self, at: float) -> float:
        """How far the gateway's clock was ahead."""
        return self.clock[bisect_right(self.clock, (at, float("inf"))) - 1][1]
