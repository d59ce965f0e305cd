"""Rules about a line where others ask, and the gateway only listens."""

from collections.abc import Callable, Iterator
from typing import Final

from gateway.config.values.duration import show_age
from gateway.diagnosis.evidence import HeardUnitEvidence, MonitorEvidence
from gateway.diagnosis.finding import IS_DOWN, Finding
from gateway.diagnosis.last import RECENT
from gateway.diagnosis.lines import CORRECT_IT, ENOUGH, about_characters, against_loss

#: From this share of the requests on, stretches that are no frames are told, and answers that are missing.
MANY: Final = 0.05
#: Below this share of the answers, it is told that few have values that are sure.
FEW: Final = 0.5
#: After the port was opened, nothing is sure until the first late window has ended.
MANY_ANSWERS: Final = 50
#: So many units are named.
_MOST_NAMED: Final = 8
_ONE_DIRECTION: Final = (
    "an adapter with one receiver hears one direction only of RS-232 and of RS-485 with four wires: "
    "it needs the bus of the devices' answers and that of the client's requests"
)


def about_monitor(line: MonitorEvidence) -> Iterator[Finding]:
    """Find why little or nothing is heard on a line; yield an `ok` row if all is well. Nobody is blamed for a rate."""
    if line.on_port.reason:
        remedy = CORRECT_IT
        if not line.on_port.is_serial:
            remedy = against_loss(line.on_port.reason, "check its address, and the device server")
        yield Finding("fix", line.name, f"{IS_DOWN}{line.on_port.reason}", remedy)
        return
    findings = [*about_characters(line.on_port), *(finding for rule in _RULES for finding in rule(line))]
    yield from findings
    if line.requests and not any(finding.level == "fix" for finding in findings):
        yield _how_it_is(line)


def _how_it_is(line: MonitorEvidence) -> Finding:
    what = f"{_requests(line.requests)} heard, {line.answers} with an answer, values of {line.sure} taken"
    if line.ago is not None and line.ago > RECENT:
        return Finding("note", line.name, f"{what}; the last one {show_age(1000 * line.ago)} ago")
    return Finding("ok", line.name, what)


def _nothing(line: MonitorEvidence) -> Iterator[Finding]:
    """Find a line on which nothing is heard, not even noise."""
    if line.requests or line.strays or line.noise or _received(line):
        return
    yield Finding(
        "fix",
        line.name,
        "nothing has been heard yet",
        "check that its client asks, the wires of the receiver (are A and B swapped?) and the ground",
    )


def _noise(line: MonitorEvidence) -> Iterator[Finding]:
    """Find bytes that are no frames: all of them, or many."""
    if not line.requests and not line.strays and (line.noise or _received(line)):
        what = f"what is heard is no Modbus at {line.on_port.baud} {line.on_port.format}, {line.mode.upper()}"
        other = "ascii" if line.mode == "rtu" else "rtu"
        remedy = f'set baud and format as at the devices, or mode = "{other}"; are A and B swapped?'
        yield Finding("fix", line.name, what, remedy)
    elif line.noise >= ENOUGH and line.noise > MANY * line.requests:
        what = f"{line.noise} stretches of bytes between {_requests(line.requests)} were no frames"
        remedy = "check termination, shield and ground; values next to them are not taken"
        yield Finding("note", line.name, what, remedy)


def _one_direction(line: MonitorEvidence) -> Iterator[Finding]:
    """Find a receiver that hears the client only, or the devices only."""
    if line.strays >= ENOUGH and not line.requests:
        yield Finding("fix", line.name, f"{line.strays} responses were heard, and no request", _ONE_DIRECTION)
    elif line.requests >= ENOUGH and not line.answers and line.asks_units:
        what = f"{_requests(line.requests)} heard, and no response"
        yield Finding("fix", line.name, what, f"{_ONE_DIRECTION}; or no device there is on")


def _few_values(line: MonitorEvidence) -> Iterator[Finding]:
    """Find answers that cannot be believed."""
    if line.answers >= MANY_ANSWERS and line.sure < FEW * line.answers:
        what = f"of {line.answers} answers, {line.sure} have values that are sure"
        remedy = (
            "until late_window has passed, none are sure after the port was opened, a request without an answer, "
            "a late answer or a broken frame; a shorter one helps"
        )
        yield Finding("note", line.name, what, remedy)


def _unheard(line: MonitorEvidence) -> Iterator[Finding]:
    """Find devices that nobody asks, and units that are asked and not configured."""
    silent = [unit for unit in line.units if not unit.requests]
    known = [unit for unit in line.units if unit.requests]
    if silent and line.requests:
        what = f"nobody has asked {_named([f'{each.name} (unit {each.on_the_wire})' for each in silent])} yet"
        remedy = "right if its client does not read them; else check their addresses on the wire"
        yield Finding("note", line.name, what, remedy, silent[0].name if len(silent) == 1 else "")
    if line.unknown_units:
        units = _named([f"{unit} ({_requests(requests)})" for unit, requests in line.unknown_units])
        what = f"units are asked that are not configured: {units}"
        yield Finding("note", line.name, what, "name them in devices to have their values")
    for unit in known:
        yield from _unanswered(unit, line)


def _unanswered(unit: HeardUnitEvidence, line: MonitorEvidence) -> Iterator[Finding]:
    missing = unit.requests - unit.answers
    if missing >= ENOUGH and missing > MANY * unit.requests and line.answers:
        what = f"{missing} of {_requests(unit.requests)} of others had no answer that was heard"
        remedy = "its client may know more: here nothing can be asked"
        yield Finding("note", unit.name, what, remedy, unit.name)


def _received(line: MonitorEvidence) -> int:
    return 0 if line.on_port.errors is None else line.on_port.errors.received


def _requests(count: int) -> str:
    return "1 request" if count == 1 else f"{count} requests"


def _named(names: list[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


_RULES: Final[tuple[Callable[[MonitorEvidence], Iterator[Finding]], ...]] = (
    _nothing,
    _noise,
    _one_direction,
    _few_values,
    _unheard,
)
