"""A map of registers as `map` prints it: a table, CSV or JSON; with the ages that the running gateway tells."""

import csv
from collections.abc import Iterator, Mapping
from io import StringIO
from math import inf
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.daemon import Conversation
from gateway.cli.kit.paint import yellow
from gateway.cli.show.register_map import MapRow, RegisterMap
from gateway.cli.show.virtual import MappedLine, line_as_json
from gateway.config.documents.points import number_text
from gateway.config.values.duration import show_age
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.values import Cell
from gateway.operator.operations.asked import Addresses
from gateway.operator.operations.table import IMAGE
from gateway.profiles.columns import ACCESS, labels_cell
from gateway.profiles.point import NO_VALUE
from gateway.registers.items import has_bits, reference

#: The columns of the CSV; those that `import csv` reads have the names that it knows.
_COLUMNS: Final = (
    *("name", "area", "address", "reference", "count", "type", "word order", "bits", "scale", "offset", "unit"),
    *("access", "labels", "length", "scale from", "device", "point", "source", "every"),
)
_HEADINGS: Final = ("ADDRESS", "REFERENCE", "NAME", "TYPE", "UNIT", "SOURCE", "EVERY")
#: This many addresses are asked for at a time: the lines do not wait for a longer answer.
_MOST: Final = 100
#: From this age on tenths of a second do not matter, in milliseconds.
_LONG: Final = 10_000


class Ages:
    """Asks a gateway for all that is polled of a map, and finds the age of each line.

    Raises:
        DaemonError: it has no such unit, or does not answer.
    """

    def __init__(self, daemon: Conversation, found: RegisterMap) -> None:
        self._cells: dict[tuple[Area, int], Cell] = {}
        for area in Area:
            for first, last in _windows(found, area):
                told = daemon.ask(IMAGE, Addresses(found.name, area, first, last))
                self._cells |= {(area, cell.address): cell for cell in told.values}

    def as_text(self, line: MappedLine) -> str:
        """Show the age of a line: `0.4 s`, `stale 12 s`, a dash if it is not known; nothing if it is not polled."""
        if line.every is None:
            return ""
        oldest = self._oldest(line)
        if oldest is None or oldest.age_ms is None:
            return NO_VALUE
        age = f"{oldest.age_ms / 1000:.1f} s" if oldest.age_ms < _LONG else show_age(oldest.age_ms)
        return age if oldest.state == "fresh" else f"{oldest.state} {age}"

    def as_json(self, line: MappedLine) -> dict[str, float]:
        """Make the age of a line for programs: nothing if it is not known."""
        oldest = None if line.every is None else self._oldest(line)
        return {} if oldest is None or oldest.age_ms is None else {"age_ms": oldest.age_ms}

    def _oldest(self, line: MappedLine) -> Cell | None:
        """Find the oldest part of a line, or one that is not known; None if the gateway has another device there."""
        cells = (self._cells.get((line.place.area, at)) for at in range(line.place.start, line.place.end))
        ours = (cell for cell in cells if cell and (not cell.source or cell.source.startswith(f"{line.device} ")))
        return max(ours, key=lambda cell: inf if cell.age_ms is None else cell.age_ms, default=None)


def _windows(found: RegisterMap, area: Area) -> Iterator[tuple[int, int]]:
    """Yield the first and last addresses of what to ask at a time, so that all that is polled is told."""
    lines = (row.line for row in found.rows if row.line.every is not None and row.line.place.area is area)
    polled = sorted({address for line in lines for address in range(line.place.start, line.place.end)})
    while polled:
        here = [address for address in polled[:_MOST] if address < polled[0] + _MOST]
        yield here[0], here[-1]
        polled = polled[len(here) :]


def map_as_text(found: RegisterMap, ages: Ages | None = None) -> str:
    """Show a map for people, with ages if they are known."""
    rows = [
        (
            f"{line.place.area} {line.place.addresses}{_bits(row)}",
            f"{reference(line.place.area, line.place.start)}{_bits(row)}",
            row.point.name if row.point else "-",
            _type(row),
            line.meaning,
            " ".join(filter(None, (line.device or "its own", line.place_there))),
            line.how_often,
            *([_painted(ages.as_text(line))] if ages else []),
            "yes" if line.write else "-",
        )
        for row in found.rows
        for line in (row.line,)
    ]
    headings = (*_HEADINGS, *(["AGE"] if ages else []), "WRITE")
    return f"Unit {found.unit}, {found.name}\n{align([headings, *rows], '  ')}"


def _painted(age: str) -> str:
    """Paint the age of a value that is not fresh, whose state stands before it."""
    return yellow(age) if age[:1].isalpha() else age


def map_as_csv(found: RegisterMap) -> str:
    """Write a map for the program of a PLC or SCADA: a row for each value, and for each range without a name."""
    text = StringIO()
    writer = csv.DictWriter(text, _COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    names = {(row.point.area, row.point.address): row.point.name for row in found.rows if row.point}
    writer.writerows(_cells(row, names) for row in found.rows)
    return text.getvalue()


def map_as_json(found: RegisterMap, ages: Ages | None = None) -> dict[str, Any]:
    """Make a map for programs, with ages if they are known."""
    return {
        "unit": int(found.unit) if found.unit.isdecimal() else None,
        "name": found.name,
        "map": [
            {"name": row.point.name if row.point else "", **line_as_json(row.line)}
            | (ages.as_json(row.line) if ages else {})
            for row in found.rows
        ],
    }


def _bits(row: MapRow) -> str:
    return row.point.bits_shown if row.point else ""


def _type(row: MapRow) -> str:
    line = row.line
    kind = line.type or ("bit" if has_bits(line.place.area) else "registers")
    return " ".join(filter(None, (kind, line.swap)))


def _cells(row: MapRow, names: Mapping[tuple[Area, int], str]) -> dict[str, str]:
    """Write the cells of a row; `names` are those of points, which may be the scales of others."""
    line, point = row.line, row.point
    is_text = line.type == "string"
    return {
        "name": point.name if point else "",
        "area": line.place.area.value,
        "address": str(line.place.start),
        "reference": reference(line.place.area, line.place.start),
        "count": str(line.place.count),
        "type": "" if has_bits(line.place.area) else point.type if point else line.type,
        "word order": line.swap,
        "bits": _bits(row)[1:],
        "scale": "" if line.scale == 1 else number_text(line.scale),
        "offset": "" if line.offset == 0 else number_text(line.offset),
        "unit": line.unit,
        "access": ACCESS["yes" if line.write else "no"],
        "labels": labels_cell(point.labels) if point else "",
        "length": str(line.place.count) if is_text else "",
        "scale from": names.get((point.area, point.scale_at), "") if point and point.scale_at is not None else "",
        "device": line.device,
        "point": line.point,
        "source": line.place_there,
        "every": line.how_often,
    }
