"""A sheet: the rows of a CSV file, whatever a spreadsheet made of it.

What separates the cells, how the letters are encoded and which row is the heading is found by the heading itself: of
all ways to read the file, that one counts in which the most columns are known.
"""

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from io import StringIO
from itertools import islice
from typing import Final, NamedTuple

from gateway.config.importing.imported import ImportedFileError

#: Tells how many columns of a heading are known.
Knows = Callable[[Sequence[str]], int]

_DELIMITERS: Final = (",", ";", "\t", "|")
#: The heading is one of the first rows; above it a title may stand.
_HEADING_ROWS: Final = 30
_FEWEST_COLUMNS: Final = 2
_MOST_ROWS: Final = 10_000
_MARKS: Final = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
#: What programs write that do not write UTF-8: in China, and in the west. The last one reads any bytes.
_CHINESE, _WESTERN = "gb18030", ("cp1252", "latin-1")
#: Chinese letters have two bytes, the first of which is not one of ASCII; western ones stand mostly alone.
_MOSTLY: Final = 0.9
_NOT_ASCII: Final = re.compile(rb"[\x80-\xff]")


class SheetRow(NamedTuple):
    """A row and its number, as the spreadsheet shows it."""

    number: int
    cells: tuple[str, ...]

    @property
    def filled(self) -> list[str]:
        """The cells that are not empty."""
        return [cell for cell in self.cells if cell]


class Sheet(NamedTuple):
    """The heading of a sheet, the rows below it, and whether numbers have a decimal comma."""

    heading: SheetRow
    rows: tuple[SheetRow, ...]
    has_decimal_comma: bool


def read_sheet(file: str, content: bytes, knows: Knows) -> Sheet:
    """Find the heading of a sheet, and read the rows below it."""
    ways = [
        (knows(row.cells), -order, -row.number, row, text, delimiter)
        for order, (text, delimiter) in enumerate((text, each) for text in _texts(content) for each in _DELIMITERS)
        for row in islice(_rows(file, text, delimiter), _HEADING_ROWS)
    ]
    if not ways or max(ways)[0] < _FEWEST_COLUMNS:
        raise ImportedFileError(
            f"{file}: no row is a heading: at least the columns name and address are needed, such as "
            '"Name;Address;Type;Unit"'
        )
    *_, heading, text, delimiter = max(ways)
    below = [row for row in _rows(file, text, delimiter) if row.number > heading.number and row.filled]
    if len(below) > _MOST_ROWS:
        raise ImportedFileError(f"{file}: has more than {_MOST_ROWS} rows")
    return Sheet(heading, tuple(below), delimiter != ",")


def _texts(content: bytes) -> Iterator[str]:
    """Decode a file in each way in which it may be meant."""
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            yield content.decode(encoding, "replace")
            return
    if b"\0" in content[:200]:
        yield content.decode("utf-16-le" if content[1:2] == b"\0" else "utf-16-be", "replace")
        return
    if _is_encoded(content, "utf-8"):
        yield content.decode()
        return
    old = (_CHINESE, *_WESTERN) if _is_mostly_in_pairs(content) else (*_WESTERN, _CHINESE)
    yield from (content.decode(each) for each in old if _is_encoded(content, each))


def _is_mostly_in_pairs(content: bytes) -> bool:
    others = len(_NOT_ASCII.findall(content))
    return sum(len(run) for run in re.findall(rb"[\xa1-\xfe]{2,}", content)) > _MOSTLY * others


def _is_encoded(content: bytes, encoding: str) -> bool:
    try:
        content.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _rows(file: str, text: str, delimiter: str) -> Iterator[SheetRow]:
    reader = csv.reader(StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True)
    try:
        for number, cells in enumerate(reader, start=1):
            yield SheetRow(number, tuple(map(_stripped, cells)))
    except csv.Error as wrong:
        raise ImportedFileError(f"{file}: line {reader.line_num}: {wrong}") from None


def _stripped(cell: str) -> str:
    """Strip spaces of every kind, those without a width too."""
    return cell.strip("\N{ZERO WIDTH NO-BREAK SPACE}\N{ZERO WIDTH SPACE}").strip()
