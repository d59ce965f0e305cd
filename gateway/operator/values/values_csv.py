"""The latest known values as CSV, for spreadsheets and scripts."""

import csv
from collections.abc import Iterable
from io import StringIO
from typing import Final

from gateway.operator.operations.answers.known_values import KnownValue

#: The columns: the age is in seconds, the time is RFC 3339 text. Where nothing is known the cell is empty.
COLUMNS: Final = ("device", "point", "value", "unit", "state", "age", "source", "time")
#: What a formula begins with in some spreadsheet.
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")


def values_as_csv(values: Iterable[KnownValue]) -> str:
    """Write a row for each point, below the headings; numbers have a decimal point in every language."""
    return csv_text(COLUMNS, map(_cells, values))


def csv_text(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Write rows below the headings."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    return text.getvalue()


def _cells(each: KnownValue) -> tuple[str, ...]:
    return (
        each.name,
        each.point,
        "" if each.value is None else harmless(each.text) if isinstance(each.value, str) else each.text,
        each.measure or "",
        each.state,
        "" if each.age_ms is None else f"{each.age_ms / 1000:.1f}",
        each.source or "",
        each.time or "",
    )


def harmless(text: str) -> str:
    """Put an apostrophe before text of others that a spreadsheet would take for a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text
