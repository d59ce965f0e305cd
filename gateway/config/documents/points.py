"""Points as CSV, which `import csv` reads again, and in words for tables. A range is one row there."""

import csv
from collections.abc import Iterator, Mapping
from io import StringIO
from typing import Final

from gateway.config.plan.points import names_of, places_of, size_of, type_of, width_of
from gateway.config.schema.profile import PointTable, ProfileTable
from gateway.modbus.codes import Area
from gateway.profiles.columns import ACCESS, COLUMNS, labels_cell, numbers_cell
from gateway.profiles.identity import Identity
from gateway.profiles.profile import Range
from gateway.registers.datatypes import BYTE_TYPES
from gateway.registers.items import has_bits, reference

#: The text for whether a point can be written.
_WRITING: Final[Mapping[str, str]] = {"no": "no", "yes": "yes", "only": "only, never read"}
#: From here on numbers are written as patterns of bits: the highest one of an int16.
_FIRST_PATTERN: Final = 0x7FFF
_SWAPS: Final[Mapping[str, str]] = {
    "none": "",
    "words": ", words swapped",
    "bytes": ", bytes swapped",
    "both": ", words and bytes swapped",
}


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


def point_rows(profile: ProfileTable) -> Iterator[dict[str, str]]:
    """Give the cells of each row, by their headings. A cell that says nothing is empty."""
    for table in profile.points:
        for area, addresses in places_of(table):
            yield {
                "name": table.name,
                "names": _names(profile, table, area, addresses),
                "area": area.value,
                "address": "-".join(dict.fromkeys(map(str, addresses))),
                "reference": _references(area, addresses),
                "type": _type(table, area),
                "scale": _scale(table),
                "unit": table.unit,
                "write": _writing(table, addresses),
                "limits": _limits(table),
                "no value": ", ".join(map(_pattern, table.invalid)),
                "labels": ", ".join(f"{number} {text}" for number, text in table.labels.items()),
            }


def identity_text(identity: Identity) -> str:
    """Say how a kind of device is recognised."""
    if identity.register is not None:
        area, address, equals = identity.register
        return f"{area} {address} is {equals}"
    if identity.sunspec:
        return f"SunSpec models {', '.join(map(str, identity.sunspec))}"
    return f'function 43/14 tells "{identity.fc43}"'


def _names(profile: ProfileTable, table: PointTable, area: Area, addresses: Range) -> str:
    """Name the first and the last point of a row."""
    first, *_, last = [*names_of(table, area, addresses, width_of(area, addresses[0], profile))] * 2
    return first if first == last else f"{first} to {last}"


def _pattern(number: float) -> str:
    """Write a number that means "no value", as documents do: large ones are patterns of bits."""
    return f"0x{number:04X}" if isinstance(number, int) and number >= _FIRST_PATTERN else number_text(number)


def _references(area: Area, addresses: Range) -> str:
    return "-".join(dict.fromkeys(reference(area, each) for each in addresses))


def _type(table: PointTable, area: Area) -> str:
    name = type_of(table, area)
    length = "" if table.length is None else f", {table.length} registers"
    byte = table.byte or ("low" if name in BYTE_TYPES else "")
    part = f", {byte} byte" if byte else ""
    if table.bit is not None:
        part = f", bit {table.bit}"
    elif table.bits is not None:
        part = f", bits {table.bits[0]}-{table.bits[1]}"
    return f"{name}{length}{part}{_SWAPS[table.swap]}"


def _scale(table: PointTable) -> str:
    """Say how a value follows from the number in the registers: `x 0.1 - 40`."""
    parts = [f"x 10^{table.scale_from}"] if table.scale_from else []
    parts += [f"x {number_text(table.scale)}"] if table.scale != 1 else []
    sign = "-" if table.offset < 0 else "+"
    parts += [f"{sign} {number_text(abs(table.offset))}"] if table.offset else []
    return " ".join(parts)


def _limits(table: PointTable) -> str:
    least, greatest = number_text(table.min), number_text(table.max)
    if least and greatest:
        return f"{least} to {greatest}"
    return f"from {least}" if least else f"up to {greatest}" if greatest else ""


def _writing(table: PointTable, addresses: Range) -> str:
    """Say whether a point can be written, where and how; of a range, where the first and the last one are."""
    parts = [_WRITING[table.write]]
    if table.write_at is not None:
        first, last = addresses
        parts.append("at " + "-".join(dict.fromkeys(str(table.write_at + each - first) for each in (first, last))))
    parts += [f"{table.write_function} function"] if table.write_function not in (None, "auto") else []
    return ", ".join(parts)
