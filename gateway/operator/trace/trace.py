"""The operation `trace`: pages of facts from the ring."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

from gateway.operator.operations.answers.trace import TracePage
from gateway.operator.operations.asked import Traced
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trace.facts import Clock, clocks, fact
from gateway.operator.trace.meanings import Points, points_of
from gateway.operator.trace.selection import lines, wanted
from gateway.operator.trace.unit_names import UnitNames
from gateway.runtime.running import Running
from gateway.trace.records import Record
from gateway.trace.ring import Ring

#: How many records a reader gets first, if it names no time.
TAIL: Final = 20
Tell = Callable[[Record, Clock, UnitNames], Any]
Choose = Callable[[Sequence[Record]], Sequence[Record]]


async def tell_page(operator: Operator, asked: Traced, _asker: Asker) -> TracePage:
    """Return facts from the ring, as `page` does, and the lines if asked for."""
    running = operator.running
    found = page(running, asked, clocks(), _with_points(points_of(operator)) if asked.points else None)
    return replace(found, lines=lines(running.gateway)) if asked.lines else found


def _with_points(points: Points) -> Tell:
    return lambda record, clock, names: points.beside(fact(record, clock, names))


def page(
    running: Running,
    asked: Traced,
    clock: Clock,
    tell: Tell | None = None,
    choose: Choose = lambda records: records,
) -> TracePage:
    """Collect one step of facts: of the records that are `asked` for, those that `choose` keeps.

    `tell` converts a record, in place of `fact`.

    Raises:
        WrongQuestion: nothing is kept, or there is no such line, unit or result.
    """
    ring = running.ring
    is_wanted = wanted(running, asked)
    number = _number(ring, asked, clock)
    records = ring.after(number)
    following = max(number, ring.first) + len(records)
    begins_at = ring.begins_at
    names = UnitNames(running.gateway)
    chosen = choose([record for record in records if is_wanted(record)])
    return TracePage(
        facts=[(tell or fact)(record, clock, names) for record in chosen],
        next=following,
        missed=max(0, ring.first - number),
        is_all=following == ring.added,
        reaches_back_s=0.0 if begins_at is None else round(clock[0] - begins_at, 3),
    )


def _number(ring: Ring, asked: Traced, clock: Clock) -> int:
    if asked.after is not None:
        return min(asked.after, ring.added)
    if asked.since is not None:
        return ring.number_at(clock[0] - asked.since)
    return max(ring.first, ring.added - TAIL)
