"""A map of registers as `map` prints it: a table, CSV or JSON."""

import csv
from collections.abc import Mapping
from io import StringIO
from typing import Any, Final

from gateway.cli.kit.columns import align
from gateway.cli.kit.paint import yellow
from gateway.cli.show.ages import Ages
from gateway.cli.show.register_map import MapRow, RegisterMap
from gateway.cli.show.virtual import line_as_json
from gateway.config.documents.points_csv import number_text
from gateway.modbus.codes import Area
from gateway.profiles.columns import ACCESS, labels_cell
from gateway.registers.items import has_bits, reference

#: The columns of the CSV; those that `import csv` reads have the names that it knows.
_COLUMNS: Final = (
    *("name", "area", "address", "reference", "count", "type", "word order", "bits", "scale", "offset", "unit"),
    *("access", "labels", "length", "scale from", "device", "point", "source", "every"),
)
_HEADINGS: Final = ("ADDRESS", "REFERENCE", "NAME", "TYPE", "UNIT", "SOURCE", "EVERY")


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
