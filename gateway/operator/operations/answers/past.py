"""The history of a line and of a unit. Times are RFC 3339 text."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LineSlot:
    """One slot of the history of a line or upstream; it begins at `time`.

    The gateway ran for `seconds` of it; the port was down for `down_s` of those. `sent` counts requests, `failed` those
    without a valid response. `busy_share` is 0 for an upstream.
    """

    time: str
    seconds: float
    busy_share: float
    down_s: float
    sent: int
    failed: int


@dataclass(frozen=True, slots=True)
class LinePast:
    """The history of a line or upstream, oldest slot first. Slots in which the gateway did not run are missing."""

    line: str
    step_s: int
    slots: tuple[LineSlot, ...]


@dataclass(frozen=True, slots=True)
class UnitSlot:
    """One slot of the history of a unit; it begins at `time`.

    `requests` are those of clients. Of these, `timeouts` got no response, `failed` no valid one for another reason, and
    `not_sent` were not sent: the unit rested, or the line was down or too busy. `answer_ms` is the mean response time,
    and `limit_share` its mean share of the limit; None without responses. The unit rested for `resting_s`.
    """

    time: str
    requests: int
    timeouts: int
    failed: int
    not_sent: int
    exceptions: int
    answer_ms: float | None
    limit_share: float | None
    resting_s: float


@dataclass(frozen=True, slots=True)
class UnitPast:
    """The history of a unit, oldest slot first. Slots in which the gateway or its line was not there are missing."""

    unit: str
    line: str
    step_s: int
    slots: tuple[UnitSlot, ...]
