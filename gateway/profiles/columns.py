"""The columns of a table of points as CSV: `profile NAME --csv` writes them, and `import csv` reads them.

Comma separated, UTF-8, quoted as in RFC 4180, in lines that end as on Unix. An empty cell is the default of its key.
Each row is one point: a range of points becomes one row for each. The file has no keys of the profile itself.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Final

#: The columns, in their order.
COLUMNS: Final = (
    "name",
    "area",  # holding, input, coils, discrete
    "address",  # from 0, decimal
    "reference",  # the number in manuals, which follows from area and address: 40001 is holding 0
    "type",
    "word order",  # the key `swap`: words, bytes, both
    "bits",  # 3, 4-6, or of a byte: high, low
    "scale",
    "offset",
    "decimals",
    "unit",
    "access",  # ACCESS
    "min",
    "max",
    "invalid",  # numbers, with SEPARATOR between them
    "labels",  # 0=off;1=running
    "length",  # the registers of a string
    "scale from",
    "write at",
    "write function",  # single, multiple
)

#: How the column `access` names what the key `write` does.
ACCESS: Final[Mapping[str, str]] = {"no": "r", "yes": "rw", "only": "w"}

#: Stands between numbers, and between labels.
SEPARATOR: Final = ";"

#: A separator before another label; any other one is a part of the text.
_NEXT_LABEL: Final = re.compile(r";(?=\s*-?(?:0x[0-9a-f]+|[0-9]+)\s*=)", re.IGNORECASE)


def labels_cell(labels: Mapping[int, str]) -> str:
    """Write labels as `0=off;1=running`. A text that looks like two labels gets a comma, and stays one."""
    return SEPARATOR.join(f"{number}={_NEXT_LABEL.sub(',', text)}" for number, text in labels.items())


def labels_of(cell: str) -> list[tuple[str, str]]:
    """Split `0=off; 0x1F=running` into numbers, as they are written, and texts; the text is empty without `=`."""
    parts = (part.partition("=") for part in _NEXT_LABEL.split(cell) if part.strip())
    return [(number.strip(), text.strip()) for number, _, text in parts]


def numbers_cell(numbers: Iterable[float]) -> str:
    """Write numbers as `32767;65535`."""
    return SEPARATOR.join(map(str, numbers))


def numbers_of(cell: str) -> list[str]:
    """Split `32767; 0xFFFF` into numbers, as they are written."""
    return [part.strip() for part in cell.split(SEPARATOR) if part.strip()]
