"""Where a point is: the addresses and reference numbers of manuals.

An address counts from 0, as in the protocol; a reference number counts from 1, and its first digit names the area:
40001 is holding register 0. Which of both a column has is said by its heading, or by the cells if all of them are
references and the first of them is one of the first of its area; then the profile says that it was guessed. Inverters
have addresses such as 32080.
"""

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple
from unicodedata import normalize

from gateway.config.importing.imported import ImportedFileError
from gateway.modbus.codes import Area
from gateway.registers.items import DIGITS

_HIGHEST: Final = 0xFFFF
_AREAS: Final = {digit: area for area, digit in DIGITS.items()}
#: The largest number in a reference of five digits, and of six.
_LAST_OF: Final = {5: 9999, 6: 65536}

#: The numbers of references begin here in most manuals.
_EARLY: Final = 1000

_HEX: Final = r"(?:0x|16#|\$|#|x)(?P<hex>[0-9a-f]{1,4})|(?P<suffixed>[0-9a-f]{1,5})h"
_ONE: Final = re.compile(
    rf"(?:{_HEX}|(?P<area>[134])[x:](?P<behind>\d{{1,5}})|(?P<digits>\d{{1,6}})|(?P<bare>[0-9a-f]{{2,4}}))"
)
_BIT: Final = re.compile(r"(?P<place>.*?)\s*[.:/]\s*(?:b|bit)?\s*(?P<bit>\d{1,2})", re.IGNORECASE)
_BETWEEN: Final = re.compile(r"\s*(?:\.{2,3}|…|[-–—~～至到]|\bto\b|\bbis\b|[,;/&+]|\s)\s*", re.IGNORECASE)
_THOUSANDS: Final = re.compile(r"\d{1,3}([,.'’ ])\d{3}")


class Place(NamedTuple):
    """The first and the last address of a row, its area if the number says so, and a bit of the register."""

    first: int
    last: int
    area: Area | None = None
    bit: int | None = None


@dataclass(frozen=True, slots=True)
class Addressing:
    """How the numbers of a column are meant."""

    is_hex: bool = False
    from_1: bool = False
    is_reference: bool = False
    #: Numbers have a decimal point with nothing behind it, as programs write that calculate with addresses.
    has_points: bool = False
    was_guessed: bool = False

    def place(self, cell: str) -> Place:
        """Parse what a cell of the column says."""
        text, bit = self._without_bit(_plain(cell))
        places = [self._one(part, cell) for part in _parts(text, cell)]
        first, last = places[0], places[-1]
        is_listed = len(places) > 2
        if first.area is not last.area or (is_listed and any(b.first != a.first + 1 for a, b in pairwise(places))):
            raise ImportedFileError(f'"{cell}" is no range of addresses')
        if last.first < first.first:
            raise ImportedFileError(f'"{cell}" ends before it begins')
        return Place(first.first, last.first, first.area, bit)

    def _without_bit(self, text: str) -> tuple[str, int | None]:
        if self.has_points:
            return re.sub(r"\.0\b", "", text), None
        found = None if _THOUSANDS.fullmatch(text) else _BIT.fullmatch(text)
        if found and _ONE.fullmatch(found["place"]) and int(found["bit"]) <= 15 and not re.search(r"^[134]:", text):
            return found["place"], int(found["bit"])
        return text, None

    def _one(self, text: str, cell: str) -> Place:
        found = _ONE.fullmatch(text)
        if found is None:
            raise ImportedFileError(f'"{cell}" is no address')
        if found["area"]:
            return _at(int(found["behind"]) - 1, cell, _AREAS[found["area"]])
        in_hex = found["hex"] or found["suffixed"] or found["bare"] or (found["digits"] if self.is_hex else None)
        if found["bare"] and not self.is_hex:
            raise ImportedFileError(f'"{cell}" is no address, unless all are hexadecimal: then write "(hex)" over them')
        if in_hex is not None:
            return _at(int(in_hex, 16) - self.from_1, cell)
        if self.is_reference:
            return _referenced(found["digits"], cell)
        return _at(int(found["digits"]) - self.from_1, cell)


def addressing_of(
    heading: str, cells: Iterable[str], *, is_reference: bool, may_be_reference: bool = True
) -> Addressing:
    """Find out how the numbers in a column with this heading are meant."""
    said = re.sub(r"[\W_]+", " ", heading.lower())
    texts = [_plain(cell) for cell in cells]
    has_points = (
        bool(texts) and all(text.endswith(".0") for text in texts if "." in text) and any("." in t for t in texts)
    )
    parts = [part for text in texts for part in _BETWEEN.split(text)]
    in_letters = all(re.fullmatch(r"[0-9a-f]{2,4}", part) for part in parts) and any(map(_has_letters, parts))
    is_protocol = re.search(r"\b(from 0|0 based|zero|protocol|pdu|hex|offset)\b", said) is not None
    is_open = may_be_reference and not is_reference and not is_protocol and _are_references(texts)
    guessed = is_open and _begin_early(texts)
    return Addressing(
        is_hex=re.search(r"\bhex|十六进制", said) is not None or in_letters,
        from_1=re.search(r"\b(from 1|1 based|one based|base 1)\b", said) is not None,
        is_reference=is_reference or guessed,
        has_points=has_points,
        was_guessed=is_open,
    )


def _has_letters(text: str) -> bool:
    return re.search(r"[a-f]", text) is not None


def _plain(cell: str) -> str:
    return normalize("NFKC", cell).lower().strip("'\" ")


def looks_like_a_place(cell: str) -> bool:
    """Tell whether a cell may be an address, or several."""
    for addressing in (Addressing(), Addressing(is_hex=True)):
        with suppress(ImportedFileError):
            addressing.place(cell)
            return True
    return bool(re.fullmatch(r"\s*\d{6}\s*", cell))


def _are_references(texts: Sequence[str]) -> bool:
    """Tell whether all numbers can be references: of five or six digits, of known areas, none number 0; bits aside."""
    places = [found["place"] if (found := _BIT.fullmatch(text)) else text for text in texts]
    numbers = [part for place in places for part in re.findall(r"[0-9a-fx]+", place)]
    return len(numbers) > 0 and all(_is_reference(number) for number in numbers)


def _begin_early(texts: Sequence[str]) -> bool:
    """Tell whether one of these references is one of the first of its area."""
    return any(int(number[1:]) <= _EARLY for text in texts for number in re.findall(r"[0-9]{5,6}", text))


def _is_reference(text: str) -> bool:
    return (
        len(text) in _LAST_OF and text.isdecimal() and text[0] in _AREAS and 1 <= int(text[1:]) <= _LAST_OF[len(text)]
    )


def _referenced(digits: str, cell: str) -> Place:
    if not _is_reference(digits):
        if len(digits) <= 4 and int(digits):  # a coil: a spreadsheet drops the zeros of 00017
            return _at(int(digits) - 1, cell, Area.COILS)
        raise ImportedFileError(f'"{cell}" is no reference number: they are 1-65536 behind 0, 1, 3 or 4, as in 40001')
    return _at(int(digits[1:]) - 1, cell, _AREAS[digits[0]])


def _at(address: int, cell: str, area: Area | None = None) -> Place:
    if not 0 <= address <= _HIGHEST:
        raise ImportedFileError(f'"{cell}" is no address: they are 0 to {_HIGHEST}')
    return Place(address, address, area)


def _parts(text: str, cell: str) -> list[str]:
    """Split the numbers of a range, or of registers one behind the other."""
    thousands = _THOUSANDS.fullmatch(text)
    if thousands:
        return [text.replace(thousands[1], "")]
    parts = _BETWEEN.split(text)
    if not all(parts):
        raise ImportedFileError(f'"{cell}" is no address')
    return parts
