"""The history of a line and of a unit."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LineSlot:
    """What a line did in one slot; `time` is its begin in seconds since 1970.

    The gateway ran for `seconds` of it, and the port was down for `down_s` of those. `sent` are requests, and `failed`
    those of them without a valid response. Of another server, `busy_share` is 0.
    """

    time: int
    seconds: float
    busy_share: float
    down_s: float
    sent: int
    failed: int


@dataclass(frozen=True, slots=True)
class LinePast:
    """What a line, or another server, did in the last hours. Slots without the gateway are not there."""

    line: str
    step_s: int
    slots: tuple[LineSlot, ...]


@dataclass(frozen=True, slots=True)
class UnitSlot:
    """What a unit did in one slot; `time` is its begin in seconds since 1970.

    `requests` are those of clients. Of them `timeouts` got no response, `failed` no valid one for another reason, and
    `not_sent` were not sent: the unit rested, the line was down or too busy. `answer_ms` is the mean time of a
    response, and `limit_share` its mean share of the limit; None without responses. The unit rested for `resting_s`.
    """

    time: int
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
    """What a unit did in the last hours. Slots without the gateway, or before the unit was there, are not there."""

    unit: str
    line: str
    step_s: int
    slots: tuple[UnitSlot, ...]
