"""Rules about a unit on a line."""

from collections.abc import Callable, Iterator
from math import ceil
from typing import Final

from gateway.config.duration import show_duration
from gateway.diagnosis.evidence import LineEvidence, UnitEvidence
from gateway.diagnosis.finding import Finding, Level
from gateway.timing.verdict import CLOSE
from gateway.timing.verdict import ENOUGH as ENOUGH_RESPONSES

#: From which share of its requests on something is wrong with a unit, and not only now and then.
WRONG: Final = 0.05
#: From which share on late or damaged answers are more than chance.
SOME: Final = 0.01
#: Less than that says nothing yet.
ENOUGH: Final = 3
#: A limit is so many times what an answer takes.
_MARGIN: Final = 1.5


def about_unit(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    """The findings about a unit, by the first rule that has any."""
    for rule in _RULES:
        found = list(rule(unit, line))
        if found:
            yield from found
            return


def name(unit: UnitEvidence) -> str:
    """How rows name the unit."""
    return f"unit {unit.unit}, {unit.name}"


def _answers_late(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:  # noqa: ARG001 - a rule
    if not unit.late:
        return
    responses = "one response" if unit.late == 1 else f"{unit.late} responses"
    what = f"{responses} came after the limit, the slowest after {show_duration(unit.latest)}"
    if unit.limit:
        what += f" (limit {show_duration(unit.limit)})"
    yield Finding("fix" if unit.late >= SOME * unit.asked else "note", name(unit), what, _longer(unit, unit.latest))


def _shares_its_address(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    """Two devices that respond at once damage both responses, each time differently."""
    what, double = "", f"two devices may have the address {unit.on_the_wire}"
    if unit.twice:
        what = f"{unit.twice} responses came twice: {double}"
    elif _is_garbled(unit) and _others_answer(unit, line):
        what = f"its responses are damaged, those of other units are not: {double}"
    elif _is_garbled(unit):
        what = f"its responses are damaged, each in another way: {double}, or the line is disturbed"
    if what:
        remedy = "disconnect one of them and give it another address"
        yield Finding("fix", name(unit), what, remedy)


def _is_damaged(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    if unit.bad_frames > WRONG * unit.asked:
        yield from _damage("fix", unit, line)


def _is_damaged_at_times(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    if unit.bad_frames >= SOME * unit.asked:
        yield from _damage("note", unit, line)


def _damage(level: Level, unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    if unit.bad_frames >= ENOUGH:
        what = f"{unit.bad_frames} of {unit.asked} responses were damaged"
        remedy = f"check format ({line.format}), wiring, termination and shield of {line.name}"
        yield Finding(level, name(unit), what, remedy)


def _is_silent(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    if not unit.is_silent:
        return
    search = line.search
    what = f"does not answer at address {unit.on_the_wire}"
    if line.is_silent if search is None else search.speeds:
        return  # the row of the line says it
    if search is not None and search.found:
        found = ", ".join(map(str, search.found))
        what += f", but a device that is not configured answers at {found}: are addresses swapped?"
        remedy = f"{unit.source}: unit = {search.found[0]}, or set the address at the device"
        yield Finding("fix", name(unit), what, remedy)
    else:
        yield Finding("fix", name(unit), what, "check power, wiring and address of the device")


def _fails(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:  # noqa: ARG001 - a rule
    if unit.is_silent or unit.ambiguous > WRONG * unit.asked:
        return  # the row of the line says it
    if unit.failed > WRONG * unit.asked and (unit.failed >= ENOUGH or not unit.answered):
        what = f"{unit.failed} of {unit.asked} requests were not answered"
        remedy = "check power and wiring of the device; modbus-gateway status shows if it goes on"
        yield Finding("fix", name(unit), what, remedy)


def _is_refusing(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    """A unit that answers with exceptions only is a device of another kind than configured."""
    if unit.exceptions < ENOUGH or unit.exceptions < unit.answered:
        return
    what = f"answers with exceptions only; is it a {unit.profile}?"
    alike = [other for other in line.units if other is not unit and _refuses(other) and other.profile != unit.profile]
    if alike:
        what = f"answers with exceptions only, and so does {name(alike[0])}: are their addresses swapped?"
        remedy = f"{unit.source}: unit = {alike[0].on_the_wire}; {alike[0].source}: unit = {unit.on_the_wire}"
        yield Finding("fix", name(unit), what, remedy)
    else:
        yield Finding("note", name(unit), what, "modbus-gateway profile shows what each kind of device accepts")


def _is_close_to_limit(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:  # noqa: ARG001 - a rule
    if unit.limit_share is not None and unit.limit_share >= CLOSE and unit.answered >= ENOUGH_RESPONSES:
        what = f"its responses take up to {unit.limit_share:.0%} of their limit"
        yield Finding("note", name(unit), what, _longer(unit, unit.limit * unit.limit_share))


def _refuses(unit: UnitEvidence) -> bool:
    return unit.exceptions >= ENOUGH and unit.exceptions == unit.answered


def _is_garbled(unit: UnitEvidence) -> bool:
    if unit.bad_frames < ENOUGH or unit.bad_frames < 0.3 * unit.asked:
        return False
    return 2 * len(set(unit.instead)) > len(unit.instead)


def _others_answer(unit: UnitEvidence, line: LineEvidence) -> bool:
    others = [other for other in line.units if other is not unit and other.asked >= ENOUGH]
    return any(other.failed <= WRONG * other.asked for other in others)


def _longer(unit: UnitEvidence, seconds: float) -> str:
    """The config line with a time-out that is long enough for responses after so many seconds."""
    longest = max(seconds, unit.limit) * _MARGIN
    step = 0.05 if longest < 1 else 0.5
    return f'{unit.source}: timeout = "{show_duration(ceil(round(longest / step, 3)) * step)}"'


_RULES: Final[tuple[Callable[[UnitEvidence, LineEvidence], Iterator[Finding]], ...]] = (
    _answers_late,
    _shares_its_address,
    _is_silent,
    _is_refusing,
    _is_damaged,
    _fails,
    _is_damaged_at_times,
    _is_close_to_limit,
)
