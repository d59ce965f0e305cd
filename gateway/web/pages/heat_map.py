"""How units have answered in the last day: a row of a picture for each, with a column for each slot of the history.

The height, the pattern and the colour of a column all show its kind.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from time import sleep
from typing import Any, Final

from gateway.operator.past.past import mean_share
from gateway.operator.status.unit_states import ShownState, is_failing
from gateway.timing.history import STEP, Past, Slot, UnitUse, together

#: The height of the picture, and of each kind of column; the kinds in the order of the legend.
HEIGHT: Final = 12
KINDS: Final = {"fine": 4, "slow": 6, "exceptions": 6, "few": 8, "many": 10, "none": 12, "idle": 1}
#: From this share of exceptions on, a column shows them.
_EXCEPTIONS: Final = 0.05
#: From this mean share of the limit on, answers are slow.
_SLOW: Final = 0.6
#: How long rows are reused, in seconds: any number of readers costs no more than one.
_KEPT: Final = 10.0
_TICKS: Final = 6
#: How many slots pictures have: one, three, six, twelve hours, a day. New gateways have not seen more.
_SPANS: Final = (6, 18, 36, 72)

_GAP: Final = " "
_LETTERS: Final = dict(zip("fseomni", KINDS, strict=True))
_LETTER_OF: Final = {kind: letter for letter, kind in _LETTERS.items()}
_RUN: Final = re.compile(r"(\S)\1*")


@dataclass(frozen=True, slots=True)
class Worst:
    """The slot with the most unanswered requests, and when it began and ended."""

    begin: str
    end: str
    unanswered: int
    requests: int


@dataclass(frozen=True, slots=True)
class HeatRow:
    """A unit in the last day: outlines of its columns by kind, and sums. `limit_share` is the mean of its responses."""

    columns: tuple[tuple[str, str], ...]
    use: UnitUse
    limit_share: float | None
    worst: Worst | None


@dataclass(frozen=True, slots=True)
class Axis:
    """The time axis of pictures: the last `hours` of the day, from the slot `first` on, with times of day along it."""

    hours: int
    first: int
    slots: int
    ticks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ShownUnits:
    """Units in the order of the page, with rows, states and the time axis; `left_out` is how many more there are.

    Units that are reached only by a listener for their line or upstream are not in `with_page`.
    """

    units: tuple[Any, ...]
    rows: Mapping[str, HeatRow]
    states: Mapping[str, ShownState]
    axis: Axis
    with_page: frozenset[str]
    kinds: Mapping[str, int] = field(default_factory=lambda: KINDS)
    left_out: int = 0


class HeatMap:
    """Makes rows in the thread that makes a page, and keeps them for a while."""

    def __init__(self) -> None:
        self._made_at = -_KEPT
        self._names: tuple[str, ...] = ()
        self._rows: Mapping[str, HeatRow] = {}

    def rows(self, units: Sequence[Any], past: Past, now: float) -> Mapping[str, HeatRow]:
        """Return the rows of units by name, at most some seconds old; `now` is the time of any monotonic clock."""
        names = tuple(unit.name for unit in units)
        if names != self._names or now - self._made_at >= _KEPT:
            rows = {}
            for unit in units:
                rows[unit.name] = row_of(past, unit.line, unit.name)
                sleep(0)  # the lines need the interpreter
            self._names, self._made_at, self._rows = names, now, rows
        return self._rows


def axis(past: Past) -> Axis:
    """Make the axis for all that is known of the last day."""
    count = len(past.slots)
    known = next((count - place for place, slot in enumerate(past.slots) if slot is not None), 0)
    slots = next((each for each in _SPANS if known <= each <= count), count)
    first = count - slots
    ticks = tuple(clock(past.first + place, past.step) for place in range(first, count, slots // _TICKS))
    return Axis(slots * past.step // 3600, first, slots, ticks)


def clock(number: int, step: int = STEP) -> str:
    """Format the begin of a slot as the local time of day."""
    return f"{datetime.fromtimestamp(number * step).astimezone():%H:%M}"


def day_and_clock(number: int) -> str:
    """Format the begin of a slot as month and day, and local time of day."""
    return f"{datetime.fromtimestamp(number * STEP).astimezone():%m-%d %H:%M}"


def midnight_before(number: int) -> float:
    """Find the number of the slot with which the day of this one begins."""
    now = datetime.fromtimestamp(number * STEP).astimezone()
    return now.replace(hour=0, minute=0, second=0).timestamp() / STEP


def kind_of(use: UnitUse | None) -> str:
    """Choose the kind of column for this use."""
    if use is None or not use.requests:
        return "idle"
    lost, share = use.unanswered / use.requests, mean_share(use) or 0.0
    if lost:
        return "none" if lost == 1.0 else "many" if is_failing(use) else "few"
    if use.exceptions / use.requests >= _EXCEPTIONS:
        return "exceptions"
    return "slow" if share >= _SLOW else "fine"


def row_of(past: Past, line: str, unit: str) -> HeatRow:
    """Draw the row of a unit on this line."""
    letters = "".join(_letter(slot, line, unit) for slot in past.slots)
    outlines: dict[str, list[str]] = {}
    for run in _RUN.finditer(letters):
        kind, width = _LETTERS[run[1]], run.end() - run.start()
        height = KINDS[kind]
        outlines.setdefault(kind, []).append(f"M{run.start()} {HEIGHT}v-{height}h{width}v{height}z")
    use = together(slot.units.get(unit) for slot in past.slots if slot is not None)
    columns = tuple((kind, "".join(outlines[kind])) for kind in KINDS if kind in outlines)
    return HeatRow(columns, use, mean_share(use), _worst(past, unit) if use.unanswered else None)


def _letter(slot: Slot | None, line: str, unit: str) -> str:
    if slot is None or line not in slot.lines:
        return _GAP
    return _LETTER_OF[kind_of(slot.units.get(unit))]


def _worst(past: Past, unit: str) -> Worst:
    uses = ((slot.units[unit], slot.number) for slot in past.slots if slot is not None and unit in slot.units)
    use, number = max(uses, key=lambda each: each[0].unanswered)
    return Worst(clock(number, past.step), clock(number + 1, past.step), use.unanswered, use.requests)
