"""Values of a unit as a table or as JSON."""

import json
from collections.abc import Sequence
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.paint import red
from gateway.cli.units.unit import Unit
from gateway.errors import ExceptionCode
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.pdu import Span
from gateway.operator.operations.parameters import fields_of
from gateway.operator.values.steps import Answer, Failure, Outcome, values_told
from gateway.profiles.reading import Reading
from gateway.registers.items import MANUAL_BASES, WRITERS, has_bits, reference

#: The text of an empty cell.
_NOTHING: Final = "-"
#: So many registers of a text are shown.
_MOST_SHOWN: Final = 8


def table(readings: Sequence[Reading], time: str = "") -> str:
    """Show a row for each value; names of points come first."""
    named, written = any(each.point.name for each in readings), any(each.before is not None for each in readings)
    headings = [
        *(["TIME"] if time else []),
        *(["POINT"] if named else []),
        *([] if named else ["ADDRESS", "REFERENCE"]),
        *(["OLD"] if written else []),
        "VALUE",
        *(["UNIT"] if any(each.point.unit for each in readings) else []),
        *(["AREA", "ADDRESS", "REFERENCE"] if named else []),
        *([] if all(has_bits(each.point.area) for each in readings) else ["HEX"]),
    ]
    cells = [{**_cells(each), "TIME": time} for each in readings]
    return align([headings, *([row[heading] for heading in headings] for row in cells)])


def picture(unit: Unit, area: Area | None, outcome: Outcome) -> dict[str, Any]:
    """Make the same for programs: of one area, or of points, which each have their own."""
    told = fields_of(values_told(unit.number, unit.name, area, outcome))
    return told if unit.name else {name: each for name, each in told.items() if name != "name"}


def failure_in_words(unit: Unit, failure: Failure) -> str:
    """Tell a failure in one sentence, and what else to try on a second line."""
    span, answer = failure.span, failure.answer
    last = "" if span.count == 1 else f"-{span.end - 1}"
    what = f"{_called(unit)}, {span.area} {span.start}{last}: {red(str(answer.complaint))}"
    advice = _advice_after_write(answer, failure.function) or advice_after(answer, span)
    return f"{what}\n  help: {advice}" if advice else what


def advice_after(answer: Answer, span: Span) -> str:
    """Guess what is meant by addresses that do not exist: the numbers of a manual, which count from 40001 or 30001."""
    base = MANUAL_BASES.get(span.area)
    if answer.exception != ExceptionCode.ILLEGAL_DATA_ADDRESS or base is None or not 0 <= span.start - base < 10_000:
        return ""
    return f"{span.start} of a manual is {span.area} {span.start - base} here"


def _advice_after_write(answer: Answer, function: int) -> str:
    """Say what else can be tried after a write. A gateway on the way refuses with 01 as a device does."""
    if not function or (answer.exception != ExceptionCode.ILLEGAL_FUNCTION and answer.result != "denied"):
        return ""
    if answer.result == "denied":
        return "modbus-gateway check shows the rights"
    if answer.result == "refused":  # which says why
        return ""
    rights = "this client may not write there: modbus-gateway check, on each gateway on the way, shows the rights"
    singles = {single: several for single, several, _ in WRITERS.values()}
    several = singles.get(FunctionCode(function))
    if several is None:
        return f"the unit does not know function {function:02}, or {rights}"
    return f"{rights}; if the unit does not know function {function:02}: --multiple writes with {several:02}"


def frames_as_text(answers: Sequence[Answer]) -> str:
    """Show requests and responses in hexadecimal."""
    return "\n".join(f"> {_hex(answer.sent)}\n< {_hex(answer.received)}" for answer in answers)


def frames_as_json(answers: Sequence[Answer]) -> list[dict[str, str]]:
    """Show them to programs."""
    return [{"sent": _hex(answer.sent), "received": _hex(answer.received)} for answer in answers]


def as_json(what: object, *, one_line: bool) -> str:
    """Write JSON; on one line if more will follow."""
    return json.dumps(what, indent=None if one_line else 2, ensure_ascii=False, default=fields_of)


def _cells(reading: Reading) -> dict[str, str]:
    point, place = reading.point, reading.place
    return {
        "POINT": point.name,
        "OLD": _NOTHING if reading.before is None else point.show(point.value(reading.before)),
        "VALUE": reading.text,
        "UNIT": point.unit,
        "AREA": place.area,
        "ADDRESS": f"{place.start}{point.bits_shown}",
        "REFERENCE": f"{reference(place.area, place.start)}{point.bits_shown}",
        "HEX": _registers(reading) or _NOTHING,
    }


def _registers(reading: Reading) -> str:
    """Show registers in hexadecimal, of a long text the first ones."""
    shown = [f"{register:0{2 * reading.point.width}X}" for register in reading.registers]
    return " ".join(shown if len(shown) <= _MOST_SHOWN else [*shown[:_MOST_SHOWN], "…"])


def _called(unit: Unit) -> str:
    if unit.number is None:
        return unit.name
    return f"{unit.name} (unit {unit.number})" if unit.name else f"unit {unit.number}"


def _hex(data: bytes) -> str:
    """Show a frame in hexadecimal; an ASCII frame as it is."""
    if data.startswith(b":") and data.endswith(b"\r\n") and data.strip().isascii():
        return data.decode("ascii").strip()
    return data.hex(" ").upper() or _NOTHING
