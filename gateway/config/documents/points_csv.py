"""Writes the points of a profile as CSV, which `import csv` reads again."""

import csv
from collections.abc import Iterator
from io import StringIO

from gateway.config.plan.areas import places_of
from gateway.config.plan.points import names_of, size_of, type_of, width_of
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.profiles.columns import ACCESS, COLUMNS, labels_cell, numbers_cell
from gateway.profiles.profile import Range
from gateway.registers.items import has_bits, reference


def points_csv(profile: ProfileTable) -> str:
    """Write a row for each point, below the headings."""
    text = StringIO()
    writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for table in profile.points:
        for area, addresses in places_of(table):
            writer.writerows(_rows(profile, table, area, addresses))
    return text.getvalue()


def _rows(profile: ProfileTable, table: PointTable, area: Area, addresses: Range) -> Iterator[dict[str, str]]:
    width = width_of(area, addresses[0], profile)
    meaning = _meaning(table, area)
    for index, name in enumerate(names_of(table, area, addresses, width)):
        shift = index * size_of(table, area, width)
        address = addresses[0] + shift
        place = {"name": name, "area": area.value, "address": str(address), "reference": reference(area, address)}
        written = {} if table.write_at is None else {"write at": str(table.write_at + shift)}
        yield {**place, **meaning, **written}


def _meaning(table: PointTable, area: Area) -> dict[str, str]:
    """Write what the points of a table have in common; a default is an empty cell."""
    cells = {
        "type": "" if has_bits(area) else type_of(table, area),
        "word order": "" if table.swap == "none" else table.swap,
        "bits": _bits(table),
        "scale": "" if table.scale == 1 else number_text(table.scale),
        "offset": "" if table.offset == 0 else number_text(table.offset),
        "decimals": "" if table.decimals is None else str(table.decimals),
        "unit": table.unit,
        "access": ACCESS[table.write],
        "min": number_text(table.min),
        "max": number_text(table.max),
        "invalid": numbers_cell(table.invalid),
        "labels": labels_cell(table.labels),
        "length": "" if table.length is None else str(table.length),
        "scale from": table.scale_from or "",
        "write function": table.write_function or "",
    }
    return {column: cell for column, cell in cells.items() if cell}


def _bits(table: PointTable) -> str:
    if table.bits is not None:
        first, last = table.bits
        return f"{first}-{last}"
    return str(table.bit) if table.bit is not None else table.byte or ""


def number_text(number: float | None) -> str:
    """Write a number so that it is read as the same one; a whole one without `.0`."""
    if number is None:
        return ""
    return str(int(number)) if number == int(number) else repr(number)
