"""The points of a unit, read once for all who want them at about the same time: an open page costs a line little."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.modbus.functions import READERS
from gateway.profiles.point import Point
from gateway.web.api.answers import Answers, Unit
from gateway.web.api.values import Ask, Outcome, read

#: Units whose last values are kept, and how long they may be shown, in seconds.
MOST_UNITS: Final = 256
SHOWN_FOR: Final = 3600.0


@dataclass(slots=True)
class _Last:
    """The last values of a unit, which has not changed since, and who reads it now."""

    unit: Unit
    target: object
    outcome: Outcome | None = None
    at: float = 0.0
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class SharedReads:
    """The last values of units. Those with other rights to one have values of their own."""

    def __init__(self, answers: Answers, clock: Callable[[], float]) -> None:
        self._answers = answers
        self._clock = clock
        #: By the number of the unit and the functions that may read it.
        self._last: OrderedDict[tuple[int, frozenset[int]], _Last] = OrderedDict()

    async def read(self, unit: Unit, ask: Ask, host: str, max_age: float) -> tuple[Outcome, float]:
        """All points that can be read, not longer than `max_age` seconds ago; and how long ago that was.

        Raises:
            ProblemError: nothing could be read.
        """
        last = self._of(unit, host)
        asked_at = self._clock()
        async with last.turn:
            now = self._clock()
            if last.outcome is None or last.at < asked_at - max_age:
                points = readable(unit)
                outcome = await read(unit, points, ask) if points else Outcome()
                last.outcome, last.at = outcome, now
            return last.outcome, self._clock() - last.at

    def shown(self, unit: Unit, host: str) -> tuple[Outcome, float] | None:
        """The last values and their age in seconds, if there are any."""
        last = self._last.get(self._key(unit, host))
        if last is None or self._has_changed(last, unit) or last.outcome is None or self._clock() - last.at > SHOWN_FOR:
            return None
        return last.outcome, self._clock() - last.at

    def forget(self, unit: Unit) -> None:
        """Something was written: the values of a unit are to be read again."""
        for key in [key for key in self._last if key[0] == unit.unit]:
            del self._last[key]

    def _of(self, unit: Unit, host: str) -> _Last:
        key = self._key(unit, host)
        last = self._last.get(key)
        if last is None or self._has_changed(last, unit):
            last = self._last[key] = _Last(unit, self._answers.target(unit.unit))
        self._last.move_to_end(key)
        if len(self._last) > MOST_UNITS:
            self._last.popitem(last=False)
        return last

    def _has_changed(self, last: _Last, unit: Unit) -> bool:
        """Whether a reload has led the number elsewhere, or given the points another meaning."""
        return last.unit != unit or last.target is not self._answers.target(unit.unit)

    def _key(self, unit: Unit, host: str) -> tuple[int, frozenset[int]]:
        functions = {READERS[point.area][0] for point in unit.points}
        return unit.unit, frozenset(each for each in functions if self._answers.may(unit.unit, each, host))


def readable(unit: Unit) -> Sequence[Point]:
    """The points that can be read."""
    return [point for point in unit.points if point.write != "only"]
