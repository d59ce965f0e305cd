"""A row of a sheet as a point of a profile: its type, the bits that count, labels, numbers, and how it is written."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, get_args

from gateway.config.importing.from_csv.headings import DESCRIPTION, DIVISOR, EXPONENT, FUNCTION, Columns
from gateway.config.importing.from_csv.place import Addressing, Place
from gateway.config.importing.from_csv.words import (
    WRITING_FUNCTIONS,
    TypeWords,
    access_of,
    area_of,
    area_of_functions,
    factor_of,
    functions_of,
    number_of,
    scaled_unit,
    swap_of,
    type_of,
)
from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.points import plain
from gateway.config.reading.toml_text import Value
from gateway.modbus.codes import Area
from gateway.profiles.columns import labels_of, numbers_of
from gateway.registers.items import WRITERS, WriteFunction, has_bits

_LONGEST_CELL: Final = 1000
_LONG_COLUMNS: Final = (DESCRIPTION, "labels")
_NOTHING: Final = frozenset({"", "-", "--", "—", "–", "/", "n/a", "na", "none", "null", "无"})
_BITS_OF_WHOLE: Final = (8, 16, 32, 64)
_BITS_OF_FLOAT: Final = (32, 64)
_BITS_OF_BCD: Final = (16, 32)
#: Longer cells are read by people only.
_LONGEST: Final = 3000
_KEY: Final = re.compile(r"-?(?:0x[0-9a-f]+|\d+)", re.IGNORECASE)
#: Labels as people write them, without an `=`: 0: off, 1: running.
_LABEL: Final = re.compile(
    r"(-?(?:0x[0-9a-f]+|\d+))\s*[:：=\-–→]+\s*(.*?)\s*(?:[;,/、，；\n]+\s*|\s+)(?=-?(?:0x[0-9a-f]+|\d+)\s*[:：=\-–→]|$)",
    re.IGNORECASE | re.DOTALL,
)


def type_keys_of(
    area: Area, words: TypeWords | None, place: Place, length: str, heading: str
) -> tuple[int, dict[str, Value]]:
    """Find the registers of a row, and the keys for its type."""
    if has_bits(area):
        return 1, {}
    registers = _registers(length, heading)
    span = place.last - place.first + 1
    if words is None:
        if (registers or span) > 1:
            raise ImportedFileError(f"it has {registers or span} registers, and no type")
        return 1, {}
    if words.kind == "string":
        count = registers or (span if span > 1 else -(-(words.characters or 0) // 2))
        if not count:
            raise ImportedFileError("a string needs a length: the number of its registers")
        return count, {"type": "string", "length": count}
    bits = words.bits or (16 * (registers or (span if span in (2, 4) else 1)))
    if words.kind == "float" and words.bits is None and registers is None and span == 1:
        bits = 32
    if words.kind == "bool":
        return 1, {}
    known = {"float": _BITS_OF_FLOAT, "bcd": _BITS_OF_BCD}.get(words.kind, _BITS_OF_WHOLE)
    if bits not in known:
        raise ImportedFileError(f"{words.kind} of {bits} bits is not known here")
    count = -(-bits // 16)
    if registers is not None and registers not in (count, span):
        raise ImportedFileError(f"{words.kind}{bits} takes {count} registers, and it has {registers}")
    kind = f"{words.kind}{bits}"
    return count, {} if kind == "uint16" else {"type": kind}


def bits_of(place: Place, cell: str, type_keys: dict[str, Value]) -> dict[str, Value]:
    """Make the keys for a part of a register. A byte is the low one unless the row says something else."""
    kind = str(type_keys.get("type", "uint16"))
    text = cell.lower().removeprefix("bits").removeprefix("bit").strip()
    if kind in ("uint8", "int8"):
        return {"byte": "high" if text in ("high", "hi", "h", "8-15", "15-8") or place.bit == 8 else "low"}
    if text in ("high", "low"):
        return {"byte": text}
    found = re.fullmatch(
        r"(\d{1,2})(?:\s*(?:-|–|~|to|\.\.|:)\s*(\d{1,2}))?", text or str("" if place.bit is None else place.bit)
    )
    if found is None:
        if text:
            raise ImportedFileError(f'"{cell}" is no bit: write 3, or 4-6')
        return {}
    if not kind.startswith(("uint", "int")):
        raise ImportedFileError(f"a bit of a {kind} means nothing")
    first, last = sorted((int(found[1]), int(found[2] or found[1])))
    return {"bit": first} if first == last else {"bits": f"{first}-{last}"}


def _registers(length: str, heading: str) -> int | None:
    """Find how many registers a row has; None if it does not say so."""
    if not length:
        return None
    found = re.fullmatch(r"(\d{1,3})(?:\.0)?\s*([a-z字节]*)\.?", length.lower())
    if found is None or not int(found[1]):
        raise ImportedFileError(f'"{length}" is no number of registers')
    number, what = int(found[1]), found[2] or heading.lower()
    if what.startswith("bit"):
        return max(1, number // 16)
    return max(1, number // 2) if "byte" in what or "字节" in what else number


def labels_in(cell: str) -> dict[str, Value]:
    """Parse labels as `profile NAME --csv` writes them, or as people do; none if it is something else."""
    if len(cell) > _LONGEST:
        return {}
    labels: dict[str, Value] = {number: text for number, text in labels_of(cell) if text}
    if not labels or not all(_KEY.fullmatch(number) for number in labels):
        found = _json_labels(cell) if cell.startswith("{") else dict(_LABEL.findall(f"{cell}\n"))
        has_words = len(found) > 1 and all(re.search(r"[^\W\d]", str(text)) for text in found.values())
        labels = found if has_words else {}  # 0-100 is a range
    texts = list(labels.values())
    is_usable = len(set(map(str, texts))) == len(texts) and all(
        isinstance(text, str) and text.strip() for text in texts
    )
    return labels if is_usable else {}


def _json_labels(cell: str) -> dict[str, Value]:
    try:
        found = json.loads(cell)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) and all(map(_KEY.fullmatch, found)) else {}


@dataclass(frozen=True, slots=True)
class RowReader:
    """Reads rows of a sheet. `point_names` are the names that its points get, by those in the sheet."""

    columns: Columns
    addressing: Addressing
    #: That of the column of references, if there is one beside that of addresses.
    references: Addressing | None
    has_decimal_comma: bool
    point_names: Mapping[str, str]

    def keys(self, cells: Sequence[str], name: str) -> dict[str, Value]:
        """Make the keys of the point in a row."""
        if any(len(cell) > _LONGEST_CELL for place, cell in enumerate(cells) if self._is_short(place)):
            raise ImportedFileError(f"a cell has more than {_LONGEST_CELL} characters")

        def cell(column: str) -> str:
            found = self.columns.cell(cells, column)
            return "" if found.lower() in _NOTHING and column != "address" else found

        place = self._place(cells)
        words = self._type_words(cell("type"))
        functions = self._functions(cell(FUNCTION))
        area = _area(place, words, cell("area"), functions)
        count, type_keys = type_keys_of(area, words, place, cell("length"), self.columns.heading("length"))
        bits = bits_of(place, cell("bits"), type_keys)
        several = place.last - place.first + 1 not in (1, count)
        addresses: Value = f"{place.first}-{place.last}" if several else place.first
        keys: dict[str, Value] = {"name": f"{name}-*" if several and "*" not in name else name, str(area): addresses}
        keys |= type_keys | self._swap(cell("word order"), words, count, area, type_keys) | bits
        keys |= self._numbers(cell)
        keys |= self._writing(cell, area, count, functions)
        labels = labels_in(cell("labels"))
        return keys | ({"labels": labels} if labels else {})

    def remark(self, cells: Sequence[str]) -> str:
        """Say what the sheet says of a row, for a comment behind its point."""
        labels = self.columns.cell(cells, "labels")
        remarks = [self.columns.cell(cells, DESCRIPTION), labels if labels and not labels_in(labels) else ""]
        return "; ".join(filter(None, remarks))

    def _is_short(self, place: int) -> bool:
        """Tell whether a column has short cells."""
        return any(place in places for column, places in self.columns.places.items() if column not in _LONG_COLUMNS)

    def _place(self, cells: Sequence[str]) -> Place:
        address, number = self.columns.cell(cells, "address"), self.columns.cell(cells, "reference")
        if not address:
            return (self.references or self.addressing).place(number)
        place = self.addressing.place(address)
        if self.references is not None and re.fullmatch(r"[0134]\d{4,5}", number):
            there = self.references.place(number)
            if there.first != place.first:
                raise ImportedFileError(f"address {address} and reference {number} are not the same place")
            return place._replace(area=there.area)
        return place

    def _type_words(self, cell: str) -> TypeWords | None:
        words = type_of(cell) if cell else None
        if cell and words is None:
            raise ImportedFileError(f'"{cell}" is no known type')
        return words

    def _functions(self, cell: str) -> frozenset[int]:
        functions = functions_of(cell) if cell else frozenset()
        if cell and not functions:
            raise ImportedFileError(f'"{cell}" is no known function')
        return functions

    def _swap(
        self, cell: str, words: TypeWords | None, count: int, area: Area, type_keys: Mapping[str, Value]
    ) -> dict[str, Value]:
        swap = swap_of(cell, self.columns.heading("word order")) if cell else words.swap if words else None
        if cell and swap is None:
            raise ImportedFileError(f'"{cell}" is no word order: write ABCD, CDAB, BADC or DCBA')
        if count == 1:  # there are no words to swap
            swap = {"words": "none", "both": "bytes"}.get(swap or "none", swap)
        if swap in (None, "none") or has_bits(area) or type_keys.get("type") in ("uint8", "int8"):
            return {}
        return {"swap": str(swap)}

    def _numbers(self, cell: Callable[[str], str]) -> dict[str, Value]:
        """Make the keys for scale, offset, decimals, unit, bounds and numbers that are no values."""
        scale, unit = self._scale(cell)
        keys: dict[str, Value] = {"scale_from": scale} if isinstance(scale, str) else {}
        if isinstance(scale, Decimal) and scale != 1:
            keys["scale"] = plain(scale)
        named = self.point_names.get(cell("scale from"), cell("scale from"))
        keys |= {"scale_from": named} if named else {}
        offset = self._number(cell("offset"))
        keys |= {"offset": plain(offset)} if offset else {}
        decimals = self._number(cell("decimals"))
        keys |= {} if decimals is None else {"decimals": plain(decimals)}
        keys |= {"unit": unit} if unit else {}
        for column in ("min", "max"):
            bound = self._number(cell(column))
            keys |= {} if bound is None else {column: plain(bound)}
        invalid = [plain(number_of(each)) for each in numbers_of(cell("invalid")) if each.lower() != "nan"]
        return keys | ({"invalid": invalid if len(invalid) > 1 else invalid[0]} if invalid else {})

    def _scale(self, cell: Callable[[str], str]) -> tuple[Decimal | str, str]:
        """Find the scale of a row, or the name of the point with its power of ten, and the unit."""
        scale, unit = Decimal(1), cell("unit").strip("[]()")
        unit = "°C" if unit in ("℃", "ºC", "˚C") else unit
        if cell("scale") in self.point_names:
            return self.point_names[cell("scale")], unit
        if cell("scale"):
            scale = factor_of(cell("scale"), has_decimal_comma=self.has_decimal_comma)
        elif cell(DIVISOR):
            scale = 1 / factor_of(cell(DIVISOR), has_decimal_comma=self.has_decimal_comma)
        elif cell(EXPONENT):
            scale = Decimal(10) ** int(factor_of(cell(EXPONENT)) if cell(EXPONENT).strip("0+-. ") else 0)
        elif not any(map(self.columns.has, ("scale", DIVISOR, EXPONENT))):
            return scaled_unit(unit)
        return scale, unit

    def _number(self, cell: str) -> Decimal | None:
        return number_of(cell, has_decimal_comma=self.has_decimal_comma) if cell else None

    def _writing(
        self, cell: Callable[[str], str], area: Area, count: int, functions: frozenset[int]
    ) -> dict[str, Value]:
        access = cell("access")
        writing = access_of(access) if access else ("yes" if functions & WRITING_FUNCTIONS else "no")
        if writing is None:
            raise ImportedFileError(f'"{access}" is no access: write R, RW or W')
        if writing == "no":
            return {}
        keys: dict[str, Value] = {"write": "only" if writing == "only" else True}
        write_at = cell("write at")
        if write_at:
            keys["write_at"] = self.addressing.place(write_at).first
        said = cell("write function").lower()
        function = said
        if said not in get_args(WriteFunction):
            function = _write_function(area, count, functions_of(said) or functions)
        return keys | ({"write_function": function} if function else {})


def _area(place: Place, words: TypeWords | None, cell: str, functions: frozenset[int]) -> Area:
    """Find the area of a row; what the row says of it must agree."""
    named = area_of(cell) if cell else None
    if cell and named is None:
        raise ImportedFileError(f'"{cell}" is no area: write holding, input, coils or discrete')
    found = {each for each in (named, place.area, area_of_functions(functions)) if each is not None}
    if len(found) > 1:
        raise ImportedFileError(f"it names two areas, {' and '.join(sorted(found))}")
    if functions and not found:
        raise ImportedFileError("its functions are of several areas")
    if not found and words is not None and words.kind == "bool" and place.bit is None:
        raise ImportedFileError("is it a coil, a discrete input, or a bit of a register? The row does not say so")
    return found.pop() if found else Area.HOLDING


def _write_function(area: Area, count: int, functions: frozenset[int]) -> str:
    """Tell how a point is written if the functions of its row leave one way only, and it is not the usual one."""
    if area not in WRITERS:
        return ""
    single, several, _ = WRITERS[area]
    return "multiple" if count == 1 and several in functions and single not in functions else ""
