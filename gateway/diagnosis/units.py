"""Rules about a unit on a line."""

from collections.abc import Callable, Iterator, Sequence
from math import ceil
from typing import Final, NamedTuple

from gateway.config.reading.source import to_write
from gateway.config.values.duration import show_duration
from gateway.devices.moved import how_to_forget
from gateway.diagnosis.evidence import LineEvidence, UnitEvidence
from gateway.diagnosis.finding import Finding, Level
from gateway.modbus.explain import OTHER_UNIT
from gateway.timing.verdict import CLOSE
from gateway.timing.verdict import ENOUGH as ENOUGH_RESPONSES

#: From this share of the requests on, a fault is more than occasional.
WRONG: Final = 0.05
#: From this share on, late or damaged answers are more than chance.
SOME: Final = 0.01
#: Fewer than this prove nothing.
ENOUGH: Final = 3
#: The most units named in one row.
MOST: Final = 5
_FROM_UNIT: Final = OTHER_UNIT.format("")
#: The proposed limit as a multiple of the slowest answer.
_MARGIN: Final = 1.5


class _Found(NamedTuple):
    """A finding, and how many requests it concerns."""

    requests: int
    finding: Finding


_Rule = Callable[[UnitEvidence, LineEvidence], Iterator[_Found]]


def about_unit(unit: UnitEvidence, line: LineEvidence) -> Iterator[Finding]:
    """Find the faults of a unit: first those to fix, then those that concern the most requests."""
    found = [each for rules in _RULES for each in _first(rules, unit, line)]
    yield from (each.finding for each in sorted(found, key=lambda each: (each.finding.level != "fix", -each.requests)))


def _first(rules: Sequence[_Rule], unit: UnitEvidence, line: LineEvidence) -> list[_Found]:
    """Return the findings of the first rule that has any: the others would describe the same fault."""
    return next(filter(None, (list(rule(unit, line)) for rule in rules)), [])


def name(unit: UnitEvidence) -> str:
    """Return the name of the unit in rows."""
    return unit.name if unit.unit is None else f"unit {unit.unit}, {unit.name}"


def _row(level: Level, unit: UnitEvidence, what: str, remedy: str) -> Finding:
    return Finding(level, name(unit), what, remedy, unit.name)


def _answers_late(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if not unit.late:
        return
    responses = "one response" if unit.late == 1 else f"{unit.late} responses"
    what = f"{responses} came after the limit, the slowest after {show_duration(unit.latest)}"
    if unit.latest_limit:
        what += f" (limit {show_duration(unit.latest_limit)})"
    what += str(unit.last_late)
    level: Level = unit.last_late.level if unit.late >= SOME * unit.asked else "note"
    yield _Found(unit.late, _row(level, unit, what, _longer(unit, line)))


def _shares_its_address(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    """Find two devices at one address: both respond at once, and damage each other differently each time."""
    what, last, double = "", unit.last_bad, f"two devices may have the address {unit.on_the_wire}"
    if unit.twice:
        what, last = f"{unit.twice} responses came twice{unit.last_twice}: {double}", unit.last_twice
    elif _is_garbled(unit) and _others_answer(unit, line):
        what = f"its responses are damaged, those of other units are not{last}: {double}"
    elif _is_garbled(unit):
        what = f"its responses are damaged, each in another way{last}: {double}, or the line is disturbed"
    if what:
        remedy = "disconnect one of them and give it another address"
        yield _Found(max(unit.bad_frames, unit.twice), _row(last.level, unit, what, remedy))


def _does_not_fit(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    """Find intact frames that do not answer the request: neither wires nor addresses are wrong."""
    if unit.why and unit.explained > WRONG * unit.asked and not line.answers_zero:
        what = f"{unit.explained} of {unit.asked} responses did not fit their requests{unit.last_bad}: {unit.why}"
        remedy = _as_it_answers(unit)
        remedy = remedy or "compare function, addresses, number and values with what the document of the device allows"
        level = unit.last_bad.level if unit.explained >= ENOUGH else "note"
        yield _Found(unit.explained, _row(level, unit, what, remedy))


def _as_it_answers(unit: UnitEvidence) -> str:
    """Return the remedy for a server that answers under another unit identifier, else an empty text."""
    before, _, answered_by = unit.why.partition(_FROM_UNIT)
    if before or not answered_by:
        return ""
    keys = {"unit": answered_by} | ({} if unit.unit is None else {"as": str(unit.unit)})
    return f"if the values in the trace are those of this unit, {to_write(unit.source, keys)}"


def _is_damaged(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if unit.damaged > WRONG * unit.asked:
        yield from _damage(unit.last_bad.level, unit, line)


def _is_damaged_at_times(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if unit.damaged >= SOME * unit.asked:
        yield from _damage("note", unit, line)


def _damage(level: Level, unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if unit.damaged >= ENOUGH:
        what = f"{unit.damaged} of {unit.asked} responses were damaged{unit.last_bad}"
        remedy = f"check format ({line.format}), wiring, termination and shield of {line.name}"
        yield _Found(unit.damaged, _row(level, unit, what, remedy))


def _is_silent(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if not unit.is_silent:
        return
    search = line.search
    what = f"does not answer at address {unit.on_the_wire}"
    if line.has_stopped or line.tells_losses or (line.is_silent if search is None else search.speeds):
        return  # the row of the line says it
    others = [str(each.unit) for each in line.units if each.is_answering and each.unit is not None]
    if others and not unit.is_configured:
        where = "behind this server" if line.in_flight else "on this line"
        what = f"a client asks for it and gets no answer; {where} {', '.join(others[:MOST])} can answer"
        remedy = "check the unit identifier in the client, then the address of the device"
        yield _Found(unit.asked, _row("note", unit, what, remedy))
        return
    remedy = _check(unit)
    found = _found_for(unit, line)
    if unit.moved_from in found:
        what += f", but a device answers at {unit.moved_from}, where the config has it"
    elif found:
        what += f", but a device that is not configured answers at {', '.join(map(str, found))}: are addresses swapped?"
        if unit.moved_from is None:
            remedy = f"{to_write(unit.source, {'unit': str(found[0])})}, or set the address at the device"
    yield _Found(unit.asked, _row("fix", unit, what, remedy))


def _found_for(unit: UnitEvidence, line: LineEvidence) -> list[int]:
    """Return the addresses that were found, except those that the config gives to other units."""
    taken = {other.moved_from for other in line.units if other is not unit}
    return [] if line.search is None else [each for each in line.search.found if each not in taken]


def _never_answers(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    """Find a unit that has never answered, where another client asks: what came was probably traffic of others."""
    if _hears_others_only(unit, line):
        instead = unit.bad_frames + unit.ambiguous
        what = f"has never answered: what came after {instead} of {unit.asked} requests was probably other traffic"
        yield _Found(unit.asked, _row("fix", unit, what, _check(unit)))


def _answers_no_more(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    """Find a unit whose last requests failed, regardless of earlier answers."""
    if not unit.in_a_row or unit.is_silent or unit.why or _others_tell(unit, line):
        return
    if line.has_stopped or line.tells_losses:
        return
    if any(each.finding.level == "fix" for each in _shares_its_address(unit, line)):
        return
    if unit.in_a_row < ENOUGH:
        what = "its last request was not answered" if unit.in_a_row == 1 else "its last 2 requests were not answered"
        yield _Found(unit.in_a_row, _row("note", unit, what, "modbus-gateway status shows if it goes on"))
    else:
        what = f"does not answer at the moment: its last {unit.in_a_row} requests failed, of {unit.asked} in all"
        yield _Found(unit.asked, _row("fix", unit, what, _check(unit)))


def _fails(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if unit.is_silent or line.has_stopped or line.tells_losses or line.answers_zero or _others_tell(unit, line):
        return
    bad = unit.bad_frames if unit.bad_frames >= max(ENOUGH, SOME * unit.asked) else unit.explained
    failed = unit.failed - min(bad + unit.late, unit.failed)  # the rest has rows of its own
    if failed > WRONG * unit.asked and (failed >= ENOUGH or not unit.answered):
        what = f"{failed} of {unit.asked} requests were not answered{unit.last_failed}"
        remedy = "check power and wiring of the device; modbus-gateway status shows if it goes on"
        if line.takes_zero:
            why = 'with transaction_id = "zero" late responses are not seen'
            remedy = f"{line.source}: a longer timeout, if it is slow ({why}); else check the device"
        elif line.in_flight > 1:
            remedy = f"if it answers when it is polled alone, {line.source}: in_flight = 1; else check the device"
        yield _Found(failed, _row(unit.last_failed.level, unit, what, remedy))


def _is_refusing(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    """Find a unit that answers only with exceptions: probably another kind of device than configured."""
    if unit.exceptions < ENOUGH or unit.exceptions < unit.answered:
        return
    what = f"answers with exceptions only; is it a {unit.profile}?"
    alike = [other for other in line.units if other is not unit and _refuses(other) and other.profile != unit.profile]
    if alike:
        what = f"answers with exceptions only, and so does {name(alike[0])}: are their addresses swapped?"
        swapped = (unit, alike[0]), (alike[0], unit)
        remedy = "; ".join(to_write(one.source, {"unit": str(other.on_the_wire)}) for one, other in swapped)
        yield _Found(unit.exceptions, _row("fix", unit, what, remedy))
    else:
        remedy = "modbus-gateway profile shows what each kind of device accepts"
        yield _Found(unit.exceptions, _row("note", unit, what, remedy))


def _is_close_to_limit(unit: UnitEvidence, line: LineEvidence) -> Iterator[_Found]:
    if _is_near_limit(unit):
        what = f"its responses take up to {unit.limit_share:.0%} of their limit"
        yield _Found(0, _row("note", unit, what, _longer(unit, line)))


def _check(unit: UnitEvidence) -> str:
    if unit.moved_from is None:
        return _CHECK_DEVICE
    return f"{_CHECK_DEVICE}; {how_to_forget(unit.name, unit.moved_from)}"


def _others_tell(unit: UnitEvidence, line: LineEvidence) -> bool:
    """Tell whether a row of the line, or another row of the unit, explains its failures."""
    return unit.ambiguous > WRONG * unit.asked or _hears_others_only(unit, line)


def _hears_others_only(unit: UnitEvidence, line: LineEvidence) -> bool:
    has_answered = bool(unit.answered or unit.late or unit.behind or unit.explained)
    return not has_answered and unit.bad_frames + unit.ambiguous >= ENOUGH and line.others >= ENOUGH


def _is_near_limit(unit: UnitEvidence) -> bool:
    return unit.limit_share is not None and unit.limit_share >= CLOSE and unit.answered >= ENOUGH_RESPONSES


def _refuses(unit: UnitEvidence) -> bool:
    return unit.exceptions >= ENOUGH and unit.exceptions == unit.answered


def _is_garbled(unit: UnitEvidence) -> bool:
    if unit.damaged < ENOUGH or unit.damaged < 0.3 * unit.asked:
        return False
    return 2 * len(set(unit.instead)) > len(unit.instead)


def _others_answer(unit: UnitEvidence, line: LineEvidence) -> bool:
    others = [other for other in line.units if other is not unit and other.asked >= ENOUGH]
    return any(other.failed <= WRONG * other.asked for other in others)


def _longer(unit: UnitEvidence, line: LineEvidence) -> str:
    """Return the remedy that gives the unit more time: a time-out for all units of its config row.

    A time-out would replace the timing table of a profile; for a unit with one, the remedy is to measure its times.
    """
    if unit.has_table:
        return f"modbus-gateway calibrate {unit.name} --active --write-profile FILE makes a profile with longer times"
    of_row = [each for each in line.units if each.source == unit.source and (each.late or _is_near_limit(each))]
    longest = max(
        max(each.latest if each.late else each.limit * (each.limit_share or 0.0), each.limit) for each in of_row
    )
    step = 0.05 if longest * _MARGIN < 1 else 0.5
    timeout = show_duration(ceil(round(longest * _MARGIN / step, 3)) * step)
    shared = f", for {', '.join(each.name for each in of_row)}" if len(of_row) > 1 else ""
    return to_write(unit.source, {"timeout": f'"{timeout}"'}) + shared


_CHECK_DEVICE: Final = "check power, wiring and address of the device"

#: Only the first rule of each row that finds anything is reported.
_RULES: Final[Sequence[Sequence[_Rule]]] = (
    (_answers_late, _is_close_to_limit),
    (_never_answers, _shares_its_address, _does_not_fit, _is_damaged, _is_damaged_at_times),
    (_is_silent, _answers_no_more, _fails),
    (_is_refusing,),
)
