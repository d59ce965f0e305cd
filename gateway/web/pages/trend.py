"""The trend of a point on the page of its unit: a line of means in a band from least to greatest, and a table."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from math import floor, log10
from typing import Any, Final, NamedTuple
from urllib.parse import urlencode

from gateway.operator.operations.answers.unit import UnitPicture
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import kept_trends
from gateway.operator.trends.numbers import has_trend
from gateway.operator.trends.told import joined, slots_of
from gateway.operator.values.known_values import known_points
from gateway.profiles.point import Point
from gateway.timing.trend import Slot
from gateway.web.pages.addresses import path_of

#: The height of the picture; its width is its number of slots.
HEIGHT: Final = 100
#: Digits that tell the greatest from the least value, those of one that does not change, and the most behind the point.
_DIGITS: Final = 4
_ALL_DIGITS: Final = 9
_MOST_PLACES: Final = 9
_TICKS: Final = 6


class Span(NamedTuple):
    """A choice of the page: so many hours, in columns and in rows of the table of so many seconds."""

    name: str
    hours: int
    column: int
    row: int


SPANS: Final = (
    Span("hour", 1, 60, 300),
    Span("day", 24, 300, 3600),
    Span("week", 168, 3600, 6 * 3600),
)


class Row(NamedTuple):
    """A row of the table, as text."""

    begin: str
    least: str
    mean: str
    greatest: str


@dataclass(frozen=True, slots=True)
class ShownTrend:
    """The trend of `point` as the page shows it: outlines of band and line in a picture `width` wide, and the table.

    `least` and `greatest` are the ends of the axis. Without any value there is no picture. `choices` are the spans with
    their addresses, and `points` all points that can be chosen.
    """

    point: Point
    span: Span
    choices: Sequence[tuple[Span, str]]
    points: Sequence[Point]
    width: int
    band: str
    line: str
    least: str
    greatest: str
    ticks: Sequence[str]
    rows: Sequence[Row]


#: Makes what the page shows of a trend.
ToShow = Callable[[], ShownTrend | None]


async def trend_to_show(operator: Operator, unit: UnitPicture, asker: Asker, query: Any) -> ToShow:
    """Read the trend that the query of an address asks for, or that of the first point over a day, or the first hour.

    Return what shows it, to be called in the thread that makes the page: nothing if no trends are kept, or no point has
    one that the asker may see.
    """
    trends = kept_trends(operator)
    points = [each.point for each in known_points(operator, unit, asker) if has_trend(each.point)]
    if trends is None or not points:
        return lambda: None
    point = next((each for each in points if each.name == query.get("trend")), points[0])
    spans = [each for each in SPANS if each.hours * 3600 <= trends.layout.kept] or [SPANS[0]]
    now = operator.clock()
    usual = spans[min(1, len(spans) - 1)]
    span = next((each for each in spans if each.name == query.get("span")), usual)
    slots = await slots_of(operator, unit, point, now - span.hours * 3600, now)
    if "span" not in query and slots and slots[0].time > now - spans[0].hours * 3600:
        span = spans[0]  # a trend that has just begun is a dot in a day
    column = max(span.column, trends.layout.step)
    first = int(now // column + 1) * column - span.hours * 3600
    slots = [slot for slot in slots if slot.time >= first]
    return partial(_shown, point, points, span, spans, slots, first, column, path_of("units", unit))


def number_format(point: Point, least: float, greatest: float) -> Callable[[float], str]:
    """Make what writes values of a point: with its decimals, or as many as tell the least from the greatest."""
    places = point.decimals
    if places is None:
        digits, size = (_DIGITS, greatest - least) if greatest > least else (_ALL_DIGITS, abs(greatest) or 1.0)
        places = min(max(0, digits - 1 - floor(log10(size))), _MOST_PLACES)
    keeps_zeros = point.decimals is not None

    def text(value: float) -> str:
        written = f"{value:.{places}f}"
        written = written if keeps_zeros or "." not in written else written.rstrip("0").rstrip(".")
        return "0" if written == "-0" else written

    return text


def _shown(
    point: Point,
    points: Sequence[Point],
    span: Span,
    spans: Sequence[Span],
    slots: Sequence[Slot],
    first: int,
    column: int,
    path: str,
) -> ShownTrend:
    columns = list(joined(slots, column))
    least = min((slot.least for slot in columns), default=0.0)
    greatest = max((slot.greatest for slot in columns), default=0.0)
    text = number_format(point, least, greatest)
    width = span.hours * 3600 // column
    runs = list(_runs(columns, column))
    height = _height(least, greatest)
    return ShownTrend(
        point=point,
        span=span,
        choices=[(each, f"{path}?{urlencode({'trend': point.name, 'span': each.name})}#trend") for each in spans],
        points=points,
        width=width,
        band="".join(_band(run, first, column, height) for run in runs),
        line="".join(_line(run, first, column, height) for run in runs),
        least=text(least),
        greatest=text(greatest),
        ticks=[_clock(first + at * span.hours * 3600 // _TICKS, span) for at in range(_TICKS)],
        rows=[_row(slot, span, text) for slot in joined(slots, max(span.row, column))][::-1],
    )


def _height(least: float, greatest: float) -> Callable[[float], str]:
    """Make what finds the place of a value from the top; one that does not change is in the middle."""
    spread = greatest - least

    def place(value: float) -> str:
        return f"{HEIGHT * (greatest - value) / spread:.4g}" if spread else f"{HEIGHT / 2:g}"

    return place


def _runs(slots: Sequence[Slot], column: int) -> Iterator[list[Slot]]:
    """Yield slots without a gap between them."""
    run: list[Slot] = []
    for slot in slots:
        if run and slot.time != run[-1].time + column:
            yield run
            run = []
        run.append(slot)
    if run:
        yield run


def _band(run: Sequence[Slot], first: int, column: int, height: Callable[[float], str]) -> str:
    """Outline the columns of a run: along the greatest values, and back along the least ones."""
    start = (run[0].time - first) // column
    there = "".join(f"V{height(slot.greatest)}h1" for slot in run)
    back = "".join(f"V{height(slot.least)}h-1" for slot in reversed(run))
    return f"M{start} {height(run[0].greatest)}{there}{back}z"


def _line(run: Sequence[Slot], first: int, column: int, height: Callable[[float], str]) -> str:
    """Draw a line along the means of a run."""
    start = (run[0].time - first) // column
    return f"M{start} {height(run[0].mean)}" + "".join(f"V{height(slot.mean)}h1" for slot in run)


def _row(slot: Slot, span: Span, text: Callable[[float], str]) -> Row:
    return Row(_clock(slot.time, span), text(slot.least), text(slot.mean), text(slot.greatest))


def _clock(time: float, span: Span) -> str:
    """Format a time in the time zone of this machine; with the day if there are several."""
    return f"{datetime.fromtimestamp(time).astimezone():{'%m-%d %H:%M' if span.hours > 24 else '%H:%M'}}"
