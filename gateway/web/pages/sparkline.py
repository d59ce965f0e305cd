"""Sparklines: the last means of a point as a small line, made on the server."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.operator.answers.unit import UnitPicture
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import RECENT_SLOTS, kept_trends
from gateway.operator.trends.told import trend_of
from gateway.profiles.point import Point
from gateway.timing.trend import Slot
from gateway.web.pages.trend import number_format

#: The size of the picture: a slot is a step to the right; lines need some room above and below.
WIDTH: Final = RECENT_SLOTS
HEIGHT: Final = 16
_INSIDE: Final = HEIGHT - 2


@dataclass(frozen=True, slots=True)
class Sparkline:
    """The path of a line through the means, with its `least` and `greatest` value as text; gaps are gaps."""

    path: str
    least: str
    greatest: str


class Sparklines:
    """The sparklines of all points, from one look at their trends; to be drawn in the thread that makes a page."""

    def __init__(self, operator: Operator, trends: Mapping[int, Sequence[Slot]], first: int, step: int) -> None:
        self._operator = operator
        self._trends = trends
        self._first = first
        self._step = step

    def of(self, unit: UnitPicture, point: Point) -> Sparkline | None:
        """Draw the line of a point of a device; None if it has no trend, or nothing was heard of it."""
        trend = trend_of(self._operator, unit, point)
        slots = self._trends.get(trend, ()) if trend is not None else ()
        return _drawn(point, slots, self._first, self._step) if slots else None


async def sparklines(operator: Operator) -> Sparklines:
    """Read what is needed for the sparklines of all points; this is shared by all who ask within a slot."""
    trends = kept_trends(operator)
    if trends is None:
        return Sparklines(operator, {}, 0, 1)
    now, step = operator.clock(), trends.layout.step
    return Sparklines(operator, await trends.recent(now), trends.layout.slot_at(now) - (RECENT_SLOTS - 1) * step, step)


def _drawn(point: Point, slots: Sequence[Slot], first: int, step: int) -> Sparkline:
    """Draw a line through the means of slots, of which there is one at least; that of `first` is at the left end."""
    least, greatest = min(slot.mean for slot in slots), max(slot.mean for slot in slots)
    spread, text = greatest - least, number_format(point, least, greatest)
    parts, next_time = [], None
    for slot in slots:
        x = (slot.time - first) // step
        y = 1 + _INSIDE * (greatest - slot.mean) / spread if spread else HEIGHT / 2
        # A slot alone is a dash.
        parts.append(f"L{x} {y:.3g}" if slot.time == next_time else f"M{x} {y:.3g}h.5")
        next_time = slot.time + step
    return Sparkline("".join(parts), text(least), text(greatest))
