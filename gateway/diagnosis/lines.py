"""Rules about a client line, or an upstream."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import ceil, floor
from typing import Final

from gateway.config.reading.source import to_write
from gateway.config.values.duration import show_age, show_duration
from gateway.diagnosis.evidence import LineEvidence, UnitEvidence
from gateway.diagnosis.finding import IS_DOWN, Finding
from gateway.diagnosis.last import RECENT, Last
from gateway.diagnosis.units import about_unit
from gateway.ports.port import CLOSED_AT_ONCE

#: An echoing adapter returns this share of the requests at least: noise may hide some.
ECHOED: Final = 0.8
#: `with_ports` leaves the row out where one about the port says more, so this is for what a driver refuses: a rate.
CORRECT_IT: Final = "correct what is named here; modbus-gateway ports shows the port"
#: This many are no coincidence.
ENOUGH: Final = 3
_CLOSED_AT_ONCE: Final = CLOSED_AT_ONCE.partition("{port}")[2]
_ONE_CLIENT_ONLY: Final = "it may serve one client only: let the other one ask this gateway instead, or disconnect it"
#: From this share of the received characters on, errors are a fault; from this share of the time on, a line is full.
WRONG: Final = 0.01
FULL: Final = 0.9


def about_line(line: LineEvidence, about_units: Iterable[Sequence[Finding]] | None = None) -> Iterator[Finding]:
    """Find the faults of a line and its units; yield an `ok` row for the units that answer.

    `about_units` are the faults of its units, if they are known already.
    """
    if line.is_standby:
        yield Finding("note", line.name, f"does not ask: {line.reason}")
        return
    if line.reason:
        remedy = CORRECT_IT
        if not line.is_serial:
            remedy = against_loss(line.reason, "check its address, and the device server")
        yield Finding("fix", line.name, f"{IS_DOWN}{line.reason}", remedy)
        return
    findings = [finding for rule in _RULES for finding in rule(line)]
    if about_units is None:
        about_units = [tuple(about_unit(unit, line)) for unit in line.units]
    findings += [finding for found in about_units for finding in found]
    yield from findings
    asked = [unit for unit in line.units if unit.asked]
    fixes = [finding for finding in findings if finding.level == "fix"]
    answering = [unit for unit in asked if unit.is_answering]
    if answering and not fixes:
        yield _how_it_is(line, answering)
    elif all(finding.unit for finding in fixes):
        yield from _who_answers(line, asked, {finding.unit for finding in fixes})
    if not line.units:
        yield Finding("note", line.name, "is up; no client has asked a unit yet")
    elif len(asked) < len(line.units):
        yield Finding("note", line.name, f"not asked yet: {len(line.units) - len(asked)} of {len(line.units)} units")


def about_characters(line: LineEvidence) -> Iterator[Finding]:
    """Find damaged and lost characters."""
    for rule in (_parity, _framing, _overrun):
        yield from rule(line)


def against_loss(reason: str, otherwise: str) -> str:
    """Choose what to do about a connection that was lost or refused for this reason."""
    return _ONE_CLIENT_ONLY if is_closed_at_once(reason) else otherwise


def is_closed_at_once(reason: str) -> bool:
    """Tell whether a connection was lost because its server closes each one as soon as it is open."""
    return _CLOSED_AT_ONCE in reason


def _losses(line: LineEvidence) -> Iterator[Finding]:
    """Find a connection that is lost again and again, or as soon as it is needed."""
    is_in_use = any(unit.ago is not None and unit.ago <= RECENT for unit in line.units)
    if not line.is_serial and (line.losses >= ENOUGH or (line.losses and not is_in_use)):
        times = "once" if line.losses == 1 else f"{line.losses} times"
        what = f"was lost {times} in the last minute: {line.loss}"
        yield Finding("fix", line.name, what, against_loss(line.loss, "check the server, and the network to it"))


def _how_it_is(line: LineEvidence, units: list[UnitEvidence]) -> Finding:
    """Count the answered requests: `ok`, or a `note` if the last answer is too old to prove anything."""
    requests, answered = sum(unit.asked for unit in units), sum(unit.answered for unit in units)
    counted = f"{100 * answered // requests} % of {requests} requests"
    ago = min(unit.ago or 0.0 for unit in units)
    if ago > RECENT:
        have = "unit has answered" if len(units) == 1 else "units have answered"
        what = f"{len(units)} {have}: {counted}, the last one {show_age(1000 * ago)} ago"
        return Finding("note", line.name, what, f"without --passive, doctor {line.name} asks again")
    return Finding("ok", line.name, f"{len(units)} {'unit answers' if len(units) == 1 else 'units answer'}: {counted}")


def _who_answers(line: LineEvidence, asked: list[UnitEvidence], ill: set[str]) -> Iterator[Finding]:
    well = [unit for unit in asked if unit.is_answering and (unit.ago or 0.0) <= RECENT and unit.name not in ill]
    if well:
        numbers = ", ".join(unit.name if unit.unit is None else str(unit.unit) for unit in well)
        what = f"unit {numbers} answers" if len(well) == 1 else f"units {numbers} answer"
        yield Finding("ok", line.name, what)


def _echo(line: LineEvidence) -> Iterator[Finding]:
    if _is_echoing(line) and not line.echo:
        what = f"the adapter returns what is sent: {line.copies} of {line.sent} requests came back"
        yield _seen(line, what, to_write(line.source, {"echo": "true"}), line.last_copy)


def _copies(line: LineEvidence) -> Iterator[Finding]:
    """Find copies of requests that are too few for a lasting echo; the adapter may have been replaced."""
    if line.copies >= ENOUGH and line.others < ENOUGH and not (_is_echoing(line) or line.echo):
        what = f"{line.copies} of {line.sent} requests came back: the adapter echoes, or another client asks the same"
        remedy = f"{to_write(line.source, {'echo': 'true'})}; if the adapter does not echo, disconnect the other client"
        yield _seen(line, what, remedy, line.last_copy)


def _second_client(line: LineEvidence) -> Iterator[Finding]:
    if line.others < ENOUGH:
        return
    copies_too = not (_is_echoing(line) or line.echo)
    others = line.others + (line.copies if copies_too else 0)
    what = f"another client sends requests on this line: {others} were heard"
    remedy = 'disconnect it, or connect it to a line of its own with role = "server"'
    yield _seen(line, what, remedy, line.last_other)


def _seen(line: LineEvidence, what: str, remedy: str, last: Last) -> Finding:
    return Finding(last.level, line.name, f"{what}{last}", remedy)


def _parity(line: LineEvidence) -> Iterator[Finding]:
    errors = line.errors
    if errors is None or errors.parity < ENOUGH or errors.parity < WRONG * errors.received:
        return
    counted = f"{errors.parity} of {errors.received} characters had a wrong parity bit{line.last_parity}"
    others = [f'"{each}"' for each in _OTHER_PARITIES if each != line.format]
    remedy = f"{to_write(line.source, {'format': ' or '.join(others)})}, as at the devices"
    yield Finding(line.last_parity.level, line.name, f"{counted}: the devices have another", remedy)


def _framing(line: LineEvidence) -> Iterator[Finding]:
    errors = line.errors
    if errors is None or errors.framing < ENOUGH or errors.framing < WRONG * errors.received:
        return
    counted = f"{errors.framing} of {errors.received} characters came without a stop bit{line.last_framing}"
    remedy = f"check baud = {line.baud} at the devices, then termination and shield"
    yield Finding(line.last_framing.level, line.name, f"{counted}: another rate, or noise", remedy)


def _overrun(line: LineEvidence) -> Iterator[Finding]:
    errors = line.errors
    if errors is not None and errors.overrun:
        what = f"{errors.overrun} received characters were lost because the computer was too slow"
        yield Finding("note", line.name, what, "use a UART with a FIFO or a USB adapter, and a less loaded computer")


def _speed(line: LineEvidence) -> Iterator[Finding]:
    search = line.search
    if search is None or not search.speeds:
        return
    if search.speed is not None:
        baud, format_ = search.speed
        what = f"nobody answers at {line.baud} {line.format}, but at {baud} {format_}"
        keys = {"baud": str(baud)} if baud != line.baud else {}
        keys |= {"format": f'"{format_}"'} if format_ != line.format else {}
        yield Finding("fix", line.name, what, to_write(line.source, keys))
    elif not search.found:
        others = "rates and formats" if search.has_parity else "rates (this port has no parity to try)"
        what = f"nobody answers at {line.baud} {line.format}, nor at {search.speeds} other {others}"
        yield Finding("fix", line.name, what, _check_line(line))


def _silence(line: LineEvidence) -> Iterator[Finding]:
    if line.tells_losses:
        return
    if line.search is None and line.is_silent:
        what = f"none of its {len(line.units)} units answers"
        if line.in_flight:
            remedy = (
                f"check the unit identifiers, and the devices behind the server; {line.source}: timeout, if it is slow"
            )
        else:
            what += f" at {line.baud} {line.format}"
            remedy = f"{_check_line(line)}; without --passive, doctor {line.name} tries other rates"
        yield Finding("fix", line.name, what, remedy)
    elif line.has_stopped:
        asked = sum(1 for unit in line.units if unit.asked)
        what = f"none of its {asked} units answers any more, though some have answered"
        remedy = "check the server, and what is behind it"
        if not line.in_flight:
            remedy = "check the power of the line, the adapter and the wires"
        yield Finding("fix", line.name, what, remedy)


def _check_line(line: LineEvidence) -> str:
    return f"check power, wires (are A and B swapped?), rate and parity ({line.format}) at the devices"


def _zero(line: LineEvidence) -> Iterator[Finding]:
    """Find a server that does not return transaction identifiers."""
    if line.answers_zero:
        what = f"answers with transaction identifier 0 in place of that of the request: {line.with_zero} responses did"
        yield Finding("fix", line.name, what, to_write(line.source, {"transaction_id": '"zero"'}))


def _hurry(line: LineEvidence) -> Iterator[Finding]:
    """Find a server that needs silence before a request, one request at a time, or two to wake up."""
    pauses = line.pauses
    if pauses.needs_gap:
        soon, later = pauses.soon, pauses.later
        what = f"loses requests that come soon after a response: {soon.lost} of {soon.asked} within "
        what += f"{show_duration(max(1, ceil(1000 * pauses.silence)) / 1000)}, {later.lost} of {later.asked} later"
        yield Finding("fix", line.name, what, to_write(line.source, {"gap": f'"{show_duration(pauses.needed)}"'}))
    elif pauses.needs_turns:
        beside, alone = pauses.beside, pauses.alone
        what = f"loses requests that come while it has another one: {beside.lost} of {beside.asked}, "
        what += f"{alone.lost} of {alone.asked} that came alone"
        yield Finding("fix", line.name, what, to_write(line.source, {"in_flight": "1"}))
    elif pauses.needs_wake:
        rested, awake, rest = pauses.rested, pauses.awake, show_duration(max(1, floor(pauses.rest)))
        what = f"loses requests to a unit that was not asked for {rest}: {rested.lost} of {rested.asked}, "
        what += f"{awake.lost} of {awake.asked} that came sooner"
        remedy = to_write(line.source, {"wake": f'"{rest}"'}) + ", if it sleeps"
        remedy += '; after_connect = "500 ms", if it loses what comes soon after connecting'
        yield Finding("fix", line.name, what, remedy)


def _full(line: LineEvidence) -> Iterator[Finding]:
    if line.busy_share is not None and line.busy_share >= FULL:
        what = f"was busy for {line.busy_share:.0%} of the last minute"
        faster = "" if line.in_flight else " raise the rate,"
        remedy = f"let clients ask less often,{faster} or let them read an [[image]] with `of`"
        yield Finding("note", line.name, what, remedy)


def _is_echoing(line: LineEvidence) -> bool:
    return line.copies >= ENOUGH and (line.copies >= ECHOED * line.sent or line.copies_in_a_row >= ENOUGH)


_OTHER_PARITIES: Final = ("8E1", "8N1", "8O1")

_RULES: Final[tuple[Callable[[LineEvidence], Iterator[Finding]], ...]] = (
    _speed,
    _silence,
    _echo,
    _copies,
    _second_client,
    _parity,
    _framing,
    _overrun,
    _losses,
    _zero,
    _hurry,
    _full,
)
