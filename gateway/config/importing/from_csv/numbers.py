"""Numbers as spreadsheets and manuals have them: 0.1, 0,1, 1/10, x10, 10^-1, 0x7FFF, 7FFFh."""

import re
from decimal import Decimal
from typing import Final
from unicodedata import normalize

from gateway.config.importing.imported import ImportedFileError

_LARGEST_EXPONENT: Final = 30
_PLAIN: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,2})?", re.ASCII)
_HEX: Final = re.compile(r"([+-]?)(?:0x([0-9a-f]{1,16})|([0-9a-f]{1,16})h)")
_POWER: Final = re.compile(r"10\s*(?:\^|\*\*|e)\s*\(?([+-]?\d{1,2})\)?")
_SIGNS: Final = str.maketrans({"−": "-", "–": "-", "×": "x", "÷": "/", "⁻": "-", "’": "'", "\N{NO-BREAK SPACE}": " "})
_GROUPS: Final = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?")


def number_of(cell: str, *, has_decimal_comma: bool = False) -> Decimal:
    """Parse a number."""
    text = normalize("NFKC", cell).translate(_SIGNS).lower().strip("' ")
    in_hex = _HEX.fullmatch(text)
    if in_hex:
        return Decimal(int(f"{in_hex[1]}{in_hex[2] or in_hex[3]}", 16))
    if "," in text:
        is_grouped = not has_decimal_comma and _GROUPS.fullmatch(text) is not None
        text = text.replace(",", "") if is_grouped or "." in text else text.replace(",", ".")
    if not _PLAIN.fullmatch(text):
        raise ImportedFileError(f'"{cell}" is no number')
    return Decimal(text)


def factor_of(cell: str, *, has_decimal_comma: bool = False) -> Decimal:
    """Parse a factor: a number, 1/10, x 0.1, /10, 10^-1; a unit may stand behind it."""
    text = normalize("NFKC", cell).translate(_SIGNS).lower().strip("' ")
    text = re.sub(r"^(?:x|\*|mal|times)\s*", "", text)
    power, parts = _POWER.fullmatch(text), [part.strip() for part in re.split(r"[/:]", text)]
    if power:
        factor = Decimal(10) ** int(power[1])
    elif len(parts) == 2 and parts[1]:
        below = number_of(parts[1], has_decimal_comma=has_decimal_comma)
        above = number_of(parts[0], has_decimal_comma=has_decimal_comma) if parts[0] else Decimal(1)
        factor = above / below if below else Decimal(0)
    else:
        factor = number_of(text, has_decimal_comma=has_decimal_comma)
    if not factor or abs(factor.adjusted()) > _LARGEST_EXPONENT:
        raise ImportedFileError(f'"{cell}" is no factor')
    return factor


def scaled_unit(unit: str) -> tuple[Decimal, str]:
    """Split a unit that has a factor: 0.1V is 0.1 and V, 0.01 is one without a unit; 1/min is a unit."""
    found = re.fullmatch(r"[x×*]?\s*(\d[\d.,]*)\s*((?:[^\d\s/.,)(^~-].*)?)", unit)
    if found is None:
        return Decimal(1), unit
    try:
        return factor_of(found[1]), found[2].strip()
    except ImportedFileError:
        return Decimal(1), unit
