"""The state of a unit in the last minutes, as pages and `status` show it: one failure among many does not change it."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from gateway.operator.operations.answers.status import Status, UnitStatus
from gateway.operator.operations.answers.unit import UnitPicture
from gateway.timing.history import Past, UnitUse, together

#: This many slots of the history count, the present one among them: 10 to 20 minutes.
SLOTS: Final = 2
#: From which share and number of requests without an answer on a unit is failing: its state, and its column is red.
MANY: Final = 0.05
_ENOUGH: Final = 3


@dataclass(frozen=True, slots=True)
class ShownState:
    """The state of a unit, and what it did in the last minutes."""

    word: Literal["not asked", "fine", "failing", "resting", "line down"]
    use: UnitUse


def is_failing(use: UnitUse) -> bool:
    """Return whether so many requests were unanswered: the one rule for the state of a unit and for its columns."""
    return bool(use.unanswered) and use.unanswered >= min(use.requests, max(_ENOUGH, MANY * use.requests))


def rests_ms(unit: UnitPicture, status: Status) -> float:
    """Return for how many milliseconds a unit that has not answered is still left alone."""
    return next((each.rests_ms for each in status.units if (each.unit, each.name) == (unit.unit, unit.name)), 0.0)


def states_of(units: Sequence[Any], past: Past, down: Container[str] = ()) -> Mapping[str, ShownState]:
    """Find the states of units, by name; `down` has the names of lines that are down."""
    states = dict(each_state(units, past))
    return states | {each.name: ShownState("line down", states[each.name].use) for each in units if each.line in down}


def lines_down(status: Status) -> frozenset[str]:
    """Return the names of the lines and servers that are down; one on standby is not."""
    return frozenset(each.name for each in status.all_lines if each.state == "down")


def each_state(units: Iterable[Any], past: Past) -> Iterator[tuple[str, ShownState]]:
    """Find the states of units one by one, each with the name of its unit."""
    slots = [slot for slot in past.slots[-SLOTS:] if slot is not None]
    for unit in units:
        yield unit.name, _state(unit, [slot.units.get(unit.name, UnitUse()) for slot in slots])


def each_state_now(units: Iterable[UnitStatus]) -> Iterator[tuple[str, ShownState]]:
    """Find the states of units where no history is kept: one that has ever answered fails only when it rests."""
    for unit in units:
        state = _state(unit, [])
        is_lasting = state.word != "failing" or unit.last_answer_ms is None
        yield unit.name, state if is_lasting else ShownState("fine", state.use)


def _state(unit: Any, uses: Sequence[UnitUse]) -> ShownState:
    use = together(uses)
    if unit.state == "resting":
        return ShownState("resting", use)
    if (unit.state == "failing" and not use.responses) or any(map(is_failing, (use, *uses[-1:]))):
        return ShownState("failing", use)
    was_asked = use.requests or unit.counts.sent
    return ShownState("fine" if was_asked else "not asked", use)
