"""The history of a line or a unit, for programs and pages."""

from gateway.clock.times import rfc_3339
from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.past import LinePast, LineSlot, UnitPast, UnitSlot
from gateway.operator.operations.asked import PastOfLine, PastOfUnit
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.units.units import picture
from gateway.timing.history import STEP, LineUse, Past, UnitUse


async def tell_line(operator: Operator, asked: PastOfLine, _asker: Asker) -> LinePast:
    """Return the history of a line or upstream in the last hours.

    Raises:
        WrongQuestion: there is no such line, or no history.
    """
    if all(each.name != asked.name for each in operator.gateway.owners):
        raise WrongQuestion(f"there is no history of a line {asked.name}")
    return line_past(past_of(operator, slots_in(asked.hours)), asked.name)


async def tell_unit(operator: Operator, asked: PastOfUnit, _asker: Asker) -> UnitPast:
    """Return the history of a unit, on a line or behind an upstream, in the last hours.

    Raises:
        WrongQuestion: there is no such unit, or no history.
    """
    gateway = operator.gateway
    name = asked.unit if isinstance(asked.unit, str) else picture(operator, asked.unit).name
    for owner in gateway.owners:
        if any(device.settings.name == name for device in owner.all_devices):
            return unit_past(past_of(operator, slots_in(asked.hours)), owner.name, name)
    known = picture(operator, asked.unit).name
    raise WrongQuestion(f"there is no history of {known}, which is not on a line")


def past_of(operator: Operator, slots: int) -> Past:
    """Return the last `slots` of the history, up to the present one.

    Raises:
        WrongQuestion: no history is kept.
    """
    if operator.history is None:
        raise WrongQuestion("no history is kept: that needs [web]")
    return operator.history.last(operator.clock(), slots)


def slots_in(hours: int) -> int:
    """Convert hours to slots of the history."""
    return hours * 3600 // STEP


def line_past(past: Past, line: str) -> LinePast:
    """Select the history of a line."""
    there = ((number, slot.lines.get(line)) for number, slot in enumerate(past.slots, past.first) if slot is not None)
    return LinePast(line, STEP, tuple(line_slot(number, use) for number, use in there if use is not None))


def line_slot(number: int, use: LineUse) -> LineSlot:
    """Convert what a line did in the slot of this number."""
    seconds, down = round(use.seconds, 1), round(use.down, 1)
    return LineSlot(_begin(number), seconds, round(use.busy_share, 4), down, int(use.sent), int(use.failed))


def unit_past(past: Past, line: str, unit: str) -> UnitPast:
    """Select the history of a unit on this line."""
    there = ((number, slot) for number, slot in enumerate(past.slots, past.first) if slot is not None)
    slots = tuple(_unit_slot(number, slot.units.get(unit, UnitUse())) for number, slot in there if line in slot.lines)
    return UnitPast(unit, line, STEP, slots)


def _unit_slot(number: int, use: UnitUse) -> UnitSlot:
    return UnitSlot(
        time=_begin(number),
        requests=use.requests,
        timeouts=use.timeouts,
        failed=use.failed,
        not_sent=use.unsent,
        exceptions=use.exceptions,
        answer_ms=round(1000 * use.answer / use.responses, 2) if use.responses else None,
        limit_share=mean_share(use),
        resting_s=round(use.resting, 1),
    )


def _begin(number: int) -> str:
    return rfc_3339(number * STEP, "seconds")


def mean_share(use: UnitUse) -> float | None:
    """Compute the mean share of the limit that responses took; None without any."""
    return round(use.share / use.responses, 4) if use.responses else None
