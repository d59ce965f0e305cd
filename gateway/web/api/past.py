"""The history as the API tells it, and as pages show it: of one line, of one unit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gateway.timing.history import STEP, LineUse, Past, UnitUse


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


#: What the document has to describe.
TYPES: Final[Mapping[str, type]] = {"LinePast": LinePast, "UnitPast": UnitPast}


def slots_in(hours: int) -> int:
    """How many slots there are in this many hours."""
    return hours * 3600 // STEP


def line_past(past: Past, line: str) -> LinePast:
    """What a line did."""
    there = ((number, slot.lines.get(line)) for number, slot in enumerate(past.slots, past.first) if slot is not None)
    return LinePast(line, STEP, tuple(line_slot(number, use) for number, use in there if use is not None))


def line_slot(number: int, use: LineUse) -> LineSlot:
    """What a line did in the slot of this number."""
    seconds, down = round(use.seconds, 1), round(use.down, 1)
    return LineSlot(number * STEP, seconds, round(use.busy_share, 4), down, int(use.sent), int(use.failed))


def unit_past(past: Past, line: str, unit: str) -> UnitPast:
    """What a unit on this line did."""
    there = ((number, slot) for number, slot in enumerate(past.slots, past.first) if slot is not None)
    slots = tuple(_unit_slot(number, slot.units.get(unit, UnitUse())) for number, slot in there if line in slot.lines)
    return UnitPast(unit, line, STEP, slots)


def _unit_slot(number: int, use: UnitUse) -> UnitSlot:
    return UnitSlot(
        time=number * STEP,
        requests=use.requests,
        timeouts=use.timeouts,
        failed=use.failed,
        not_sent=use.unsent,
        exceptions=use.exceptions,
        answer_ms=round(1000 * use.answer / use.responses, 2) if use.responses else None,
        limit_share=mean_share(use),
        resting_s=round(use.resting, 1),
    )


def mean_share(use: UnitUse) -> float | None:
    """The mean share of the limit that responses took; None without any."""
    return round(use.share / use.responses, 4) if use.responses else None


def together(uses: Iterable[UnitUse | None]) -> UnitUse:
    """All of them; those that are None did nothing."""
    there = [use for use in uses if use is not None]
    return UnitUse(*map(sum, zip(*there, strict=True))) if there else UnitUse()
