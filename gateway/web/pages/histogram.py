"""Answer times of a function against their limit, as a template draws them, on a logarithmic scale."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import log
from typing import Final

from gateway.operator.units.answer_times import FunctionTimes

#: The size of the plot, in units of its own. Below it are the times, above it the marks.
WIDTH: Final = 600.0
HEIGHT: Final = 72.0
#: The least time that is shown, in milliseconds, and the factor by which the scale exceeds what it shows.
_LEAST: Final = 0.5
_BEYOND: Final = 1.6
_TICKS: Final = (1, 10, 100, 1000, 10_000, 100_000)


@dataclass(frozen=True, slots=True)
class Bar:
    """The responses of one bucket, `from_ms` to `to_ms`; the last one has no end. Its area stands for their `count`."""

    x: float
    width: float
    height: float
    count: int
    from_ms: float
    to_ms: float | None


@dataclass(frozen=True, slots=True)
class Mark:
    """A time: `kind` is limit, proposed or p99."""

    kind: str
    x: float
    ms: float


@dataclass(frozen=True, slots=True)
class Plot:
    """A histogram; `ticks` are the times on its axis, and where they are."""

    bars: tuple[Bar, ...]
    marks: tuple[Mark, ...]
    ticks: tuple[tuple[float, int], ...]


def plotted(times: FunctionTimes) -> Plot:
    """Make the plot of these times; without responses it has no bars."""
    scale = _Scale(times)
    bars = tuple(_bars(times, scale))
    marks = (("p99", times.p99_ms), ("proposed", times.proposed_ms), ("limit", times.limit_ms))
    return Plot(
        bars,
        tuple(Mark(kind, scale.x(ms), ms) for kind, ms in marks if ms),
        tuple((scale.x(tick), tick) for tick in _TICKS if scale.low <= tick <= scale.high),
    )


class _Scale:
    def __init__(self, times: FunctionTimes) -> None:
        used = [bucket for bucket, count in enumerate(times.counts) if count]
        ends = [times.bounds_ms[min(bucket, len(times.bounds_ms) - 1)] for bucket in used]
        begins = [times.bounds_ms[bucket - 1] if bucket else _LEAST for bucket in used]
        shown = [each for each in (times.limit_ms, times.proposed_ms) if each]
        self.low = max(min([*begins, *shown], default=1.0) / _BEYOND, _LEAST)
        self.high = max([*ends, *shown], default=10.0) * _BEYOND
        self._begin, self._length = log(self.low), log(self.high) - log(self.low)

    def x(self, ms: float) -> float:
        return round(min(max((log(max(ms, _LEAST)) - self._begin) / self._length, 0.0), 1.0) * WIDTH, 1)


def _bars(times: FunctionTimes, scale: _Scale) -> Iterator[Bar]:
    edges = (_LEAST, *times.bounds_ms, scale.high)
    places = [(scale.x(low), scale.x(high)) for low, high in pairwise(edges)]
    dense = [count / max(end - begin, 1.0) for count, (begin, end) in zip(times.counts, places, strict=True)]
    for bucket, count in enumerate(times.counts):
        if count:
            begin, end = places[bucket]
            height = max(dense[bucket] / max(dense) * HEIGHT, 1.5)
            to_ms = times.bounds_ms[bucket] if bucket < len(times.bounds_ms) else None
            from_ms = times.bounds_ms[bucket - 1] if bucket else 0.0
            yield Bar(begin, round(max(end - begin - 1, 1.0), 1), round(height, 1), count, from_ms, to_ms)
