"""Sparklines: the last means of a point as a small line, made on the server."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan, nan
from typing import Final

from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import RECENT_SLOTS, kept_trends
from gateway.operator.trends.told import trend_of
from gateway.profiles.point import Point
from gateway.timing.trend import Means
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

    def __init__(self, operator: Operator, trends: Mapping[int, Means]) -> None:
        self._operator = operator
        self._trends = trends

    def of(self, unit: UnitPicture, point: Point) -> Sparkline | None:
        """Draw the line of a point of a device; None if it has no trend, or nothing was heard of it."""
        trend = trend_of(self._operator, unit, point)
        means = self._trends.get(trend) if trend is not None else None
        return None if means is None else _drawn(point, means)


async def sparklines(operator: Operator) -> Sparklines:
    """Read what is needed for the sparklines of all points; this is shared by all who ask within a slot."""
    trends = kept_trends(operator)
    return Sparklines(operator, {} if trends is None else await trends.recent(operator.clock()))


def _drawn(point: Point, means: Means) -> Sparkline:
    """Draw a line through means, of which one is a number at least; each is a step to the right."""
    known = [mean for mean in means if not isnan(mean)]
    least, greatest = min(known), max(known)
    spread, text = greatest - least, number_format(point, least, greatest)
    parts, before = [], nan
    for x, mean in enumerate(means):
        if not isnan(mean):
            y = 1 + _INSIDE * (greatest - mean) / spread if spread else HEIGHT / 2
            # A slot alone is a dash.
            parts.append(f"M{x} {y:.3g}h.5" if isnan(before) else f"L{x} {y:.3g}")
        before = mean
    return Sparkline("".join(parts), text(least), text(greatest))
