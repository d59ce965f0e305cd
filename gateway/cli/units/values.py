"""Values of a unit as a table or as JSON."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.units.unit import Answer, Unit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Reading
from gateway.registers.items import has_bits, reference

#: The text of an empty cell.
_NOTHING: Final = "-"


@dataclass(frozen=True, slots=True)
class Failure:
    """A request that got an exception, its addresses, and what else to try."""

    span: Span
    answer: Answer
    advice: str = ""

    def text(self, unit: Unit) -> str:
        """The failure in one sentence, and the advice on a second line."""
        last = "" if self.span.count == 1 else f"-{self.span.end - 1}"
        what = f"{_called(unit)}, {self.span.area} {self.span.start}{last}: {self.answer.complaint}"
        return f"{what}\n  help: {self.advice}" if self.advice else what


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was read or written, what failed, and all answers."""

    readings: list[Reading] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)


def table(readings: Sequence[Reading], time: str = "") -> str:
    """A row for each value; names of points come first."""
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
    """The same as JSON: of one area, or of points, which each have their own."""
    result: dict[str, Any] = {"unit": unit.number}
    if unit.name:
        result["name"] = unit.name
    if area is not None:
        result["area"] = area
    result["values"] = [each.as_json(with_area=area is None) for each in outcome.readings]
    result["elapsed_ms"] = round(sum(answer.elapsed_ms for answer in outcome.answers), 1)
    if outcome.failures:
        result["errors"] = [
            {
                "area": each.span.area,
                "address": each.span.start,
                "count": each.span.count,
                "exception": each.answer.exception,
                "reason": each.answer.complaint,
            }
            for each in outcome.failures
        ]
    return result


def frames_as_text(answers: Sequence[Answer]) -> str:
    """Requests and responses in hexadecimal."""
    return "\n".join(f"> {_hex(answer.sent)}\n< {_hex(answer.received)}" for answer in answers)


def frames_as_json(answers: Sequence[Answer]) -> list[dict[str, str]]:
    """The same for programs."""
    return [{"sent": _hex(answer.sent), "received": _hex(answer.received)} for answer in answers]


def as_json(what: object, *, one_line: bool) -> str:
    """JSON text; on one line if more will follow."""
    return json.dumps(what, indent=None if one_line else 2, ensure_ascii=False)


def _cells(reading: Reading) -> dict[str, str]:
    point = reading.point
    return {
        "POINT": point.name,
        "OLD": _NOTHING if reading.before is None else point.show(point.value(reading.before)),
        "VALUE": point.show(reading.value),
        "UNIT": point.unit,
        "AREA": point.area,
        "ADDRESS": str(point.address),
        "REFERENCE": reference(point.area, point.address),
        "HEX": " ".join(f"{register:04X}" for register in reading.registers) or _NOTHING,
    }


def _called(unit: Unit) -> str:
    return f"{unit.name} (unit {unit.number})" if unit.name else f"unit {unit.number}"


def _hex(data: bytes) -> str:
    """A frame in hexadecimal; an ASCII frame as it is."""
    if data.startswith(b":") and data.endswith(b"\r\n") and data.strip().isascii():
        return data.decode("ascii").strip()
    return data.hex(" ").upper() or _NOTHING
