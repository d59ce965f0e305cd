"""A profile out of a sheet: what is understood of it, and at its place what is not."""

import re
from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Final

from gateway.config.importing.from_csv.headings import DIVISOR, Columns, columns_of, known_columns
from gateway.config.importing.from_csv.place import Addressing, addressing_of
from gateway.config.importing.from_csv.row import RowReader
from gateway.config.importing.from_csv.sheet import Sheet, SheetRow, read_sheet
from gateway.config.importing.from_csv.words import factor_of
from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.importing.points import Check, PointNames, PointRow, ProfilePart, is_point_name, write
from gateway.modbus.codes import Area
from gateway.profiles.columns import COLUMNS

_RESERVED: Final = re.compile(r"reserved?|reserviert|unused|not used|spare|保留|预留", re.IGNORECASE)


def profile_from_csv(file: str, name: str, content: bytes, check: Check) -> Imported:
    """Write the profile `name` with the points in a sheet, which is the `content` of a `file`."""
    sheet = read_sheet(file, content, known_columns)
    columns = columns_of(sheet)
    if not columns.has("address") and not columns.has("reference"):
        raise ImportedFileError(f"{file}: row {sheet.heading.number}: no column has addresses")
    addressing, references = _addressings(sheet, columns)
    notes = [*_notes(sheet, columns, addressing)]
    read_as = "" if _is_ours(sheet) else f": {_read_as(columns)}"
    comments = (f"From {PurePath(file).name}{read_as}", *notes)
    points = [*_points(sheet, columns, addressing, references)]
    profile = ProfilePart(name, {"source": PurePath(file).name}, points, comments)
    return write(file, [profile], check, notes=notes)


def _addressings(sheet: Sheet, columns: Columns) -> tuple[Addressing, Addressing | None]:
    """Find out how the addresses are meant, and the references if there are some too."""
    found = [
        addressing_of(
            columns.heading(column),
            [cell for row in sheet.rows if (cell := columns.cell(row.cells, column))],
            is_reference=column == "reference",
            may_be_reference=not columns.has("reference"),
        )
        for column in ("address", "reference")
        if columns.has(column)
    ]
    return found[0], found[1] if len(found) > 1 else None


def _points(
    sheet: Sheet, columns: Columns, addressing: Addressing, references: Addressing | None
) -> Iterator[PointRow]:
    names = _names(sheet, columns)
    texts = {row.number: columns.cell(row.cells, "name") for row in reversed(sheet.rows) if row.number in names}
    by_text = {text: names[number] for number, text in texts.items() if text}
    reader = RowReader(columns, addressing, references, sheet.has_decimal_comma, by_text)
    for row in sheet.rows:
        wanted = columns.cell(row.cells, "name")
        place = f"row {row.number}: {wanted}" if wanted else f"row {row.number}"
        if row.cells == sheet.heading.cells:
            continue
        if row.number not in names:
            is_title = len(row.filled) == 1
            yield PointRow(place, remark=row.filled[0], why="" if is_title else "it has no address")
        elif _RESERVED.fullmatch(wanted):
            yield PointRow(place, remark=place)
        else:
            try:
                keys = reader.keys(row.cells, names[row.number])
                yield PointRow(place, keys, reader.remark(row.cells))
            except ImportedFileError as wrong:
                yield PointRow(place, why=str(wrong))


def _names(sheet: Sheet, columns: Columns) -> dict[int, str]:
    """Choose the names of the points, by rows: in a sheet of `profile NAME --csv` those that stand there."""
    rows = [row for row in sheet.rows if _has_place(row, columns)]
    wanted = [columns.cell(row.cells, "name") for row in rows]
    if _is_ours(sheet) and len(set(wanted)) == len(wanted) and all(map(is_point_name, wanted)):
        return {row.number: name for row, name in zip(rows, wanted, strict=True)}
    names = PointNames()
    return {row.number: names.name(name, f"row-{row.number}") for row, name in zip(rows, wanted, strict=True)}


def _is_ours(sheet: Sheet) -> bool:
    """Tell whether a sheet has the columns that `profile NAME --csv` writes."""
    return set(COLUMNS) <= set(sheet.heading.cells)


def _has_place(row: SheetRow, columns: Columns) -> bool:
    return any(columns.cell(row.cells, column) for column in ("address", "reference"))


def _read_as(columns: Columns) -> str:
    """Say which columns were read as what, and which were not."""
    used = "; ".join(
        f"{column} = {' / '.join(columns.headings[place] for place in places)}"
        for column, places in columns.places.items()
    )
    unused = ", ".join(columns.unused)
    return f"{used}; not read: {unused}" if unused else used


def _notes(sheet: Sheet, columns: Columns, addressing: Addressing) -> Iterator[str]:
    """Say what was taken for granted."""
    if addressing.was_guessed and not addressing.is_reference:
        yield (
            f'The numbers under "{columns.heading("address")}" were read as addresses that count from 0. If they are '
            'references, 40001 for the first holding register, write "reference" over them'
        )
    elif addressing.was_guessed:
        yield (
            f'The numbers under "{columns.heading("address")}" were read as references: 40001 is holding register 0. '
            'If they are addresses of the protocol, write "protocol address" over them'
        )
    elif addressing.from_1:
        yield "The addresses were read as counted from 1"
    elif columns.has("address") and not columns.has("reference"):
        yield (
            "The addresses were read as counted from 0. If the first register of the manual is 1, write "
            '"address (from 1)" over them'
        )
    if addressing.is_hex:
        yield "The addresses were read as hexadecimal: 10 is 16"
    names_area = any(columns.has(column) for column in ("area", "function", "reference")) or addressing.is_reference
    if not names_area:
        yield f"No column names an area: all are {Area.HOLDING} registers"
    if _divides(sheet, columns):
        yield 'No factor is below 1. If the value is divided by it, as by a gain of 10, write "divisor" over the column'


def _divides(sheet: Sheet, columns: Columns) -> bool:
    """Tell whether the factors look like those by which is divided."""
    cells: Sequence[str] = [cell for row in sheet.rows if (cell := columns.cell(row.cells, "scale"))]
    factors = []
    for cell in cells:
        try:
            factors.append(factor_of(cell, has_decimal_comma=sheet.has_decimal_comma))
        except ImportedFileError:
            continue
    return not columns.has(DIVISOR) and any(factor > 1 for factor in factors) and all(factor >= 1 for factor in factors)
